// SPDX-License-Identifier: BSD-3-Clause
#include "geometry/triangulate.h"

#include <cmath>

namespace dsorb {
namespace {

/// Below this squared displacement per unit of inverse depth (normalised image units, translation
/// of any scale) the measurement is at the epipole up to rounding.
constexpr double kMinSquaredSensitivity = 1e-24;

}  // namespace

std::optional<TriangulatedPoint> triangulateInverseDepth(const SE3& T_target_host,
                                                         const Eigen::Vector3d& host_ray,
                                                         const Eigen::Vector2d& target,
                                                         double sigma) {
  const Eigen::Vector3d r = T_target_host.unitQuaternion() * host_ray;
  const Eigen::Vector3d& t = T_target_host.translation();
  const Eigen::Vector2d a = target * t.z() - t.head<2>();
  const Eigen::Vector2d b = r.head<2>() - target * r.z();
  const double squared_sensitivity = a.squaredNorm();
  if (!(squared_sensitivity > kMinSquaredSensitivity)) return std::nullopt;
  const double inverse_depth = a.dot(b) / squared_sensitivity;
  const double z = r.z() + inverse_depth * t.z();
  return TriangulatedPoint{inverse_depth, sigma * sigma * z * z / squared_sensitivity};
}

double parallaxAngle(const SE3& T_target_host,
                     const Eigen::Vector3d& host_ray,
                     const Eigen::Vector3d& target_ray) {
  const Eigen::Vector3d turned = T_target_host.unitQuaternion() * host_ray;
  return std::atan2(turned.cross(target_ray).norm(), turned.dot(target_ray));
}

}  // namespace dsorb
