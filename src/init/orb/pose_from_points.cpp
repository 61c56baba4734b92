// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/pose_from_points.h"

#include "camera/reprojection.h"

#include <Eigen/Cholesky>

#include <cmath>
#include <cstddef>

namespace dsorb::init_orb {
namespace {

constexpr std::size_t kMinSightings = 10;  // six unknowns, two equations each, and some to spare
constexpr int kMaxIterations = 20;
constexpr double kMinStep = 1e-8;             // norm of the increment; the end of iteration
const double kHuberLimit = std::sqrt(5.991);  // [sigma]; chi-square, 2 dof, 95 %

struct NormalEquations {
  Matrix6d H = Matrix6d::Zero();
  Vector6d b = Vector6d::Zero();
  std::size_t within = 0;  // sightings inside the Huber limit
};

NormalEquations linearize(const std::vector<PointSighting>& sightings,
                          const PinholeCamera& camera,
                          const SE3& T_cam_host,
                          double limit) {
  NormalEquations equations;
  for (const PointSighting& sighting : sightings) {
    const auto projection =
        projectHosted(camera, T_cam_host, sighting.host_ray, sighting.inverse_depth);
    if (!projection) continue;
    const Eigen::Vector2d residual = sighting.pixel - projection->pixel;
    const double norm = residual.norm();
    const double weight = norm <= limit ? 1.0 : limit / norm;
    equations.within += norm <= limit ? 1 : 0;
    equations.H += weight * projection->J_pose.transpose() * projection->J_pose;
    equations.b += weight * projection->J_pose.transpose() * residual;
  }
  return equations;
}

}  // namespace

std::optional<SE3> poseFromPoints(const std::vector<PointSighting>& sightings,
                                  const PinholeCamera& camera,
                                  const SE3& guess,
                                  double sigma) {
  if (sightings.size() < kMinSightings) return std::nullopt;
  const double limit = kHuberLimit * sigma;
  SE3 T_cam_host = guess;
  for (int iteration = 0; iteration < kMaxIterations; ++iteration) {
    const NormalEquations equations = linearize(sightings, camera, T_cam_host, limit);
    const Vector6d step = equations.H.ldlt().solve(equations.b);
    if (!step.allFinite()) return std::nullopt;
    T_cam_host = SE3::exp(step) * T_cam_host;
    if (step.norm() < kMinStep) break;
  }
  const std::size_t within = linearize(sightings, camera, T_cam_host, limit).within;
  if (2 * within < sightings.size()) return std::nullopt;
  return T_cam_host;
}

}  // namespace dsorb::init_orb
