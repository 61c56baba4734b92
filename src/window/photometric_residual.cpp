// SPDX-License-Identifier: BSD-3-Clause
#include "window/photometric_residual.h"

namespace dsorb::window {
namespace {

/// Intrinsics enter twice: in the host's ray and in the target's projection.
void addCameraRows(const Eigen::Vector3f& ray,
                   const Eigen::Vector3f& projected,  // u, v, 1 / z of the target's ray
                   const PairGeometry& pair,
                   float fx_over_fy,
                   ResidualGeometry& geometry) {
  constexpr auto kScale = static_cast<float>(kCameraScale);
  const Eigen::Matrix3f& R = pair.R_first;
  const float u = projected.x();
  const float v = projected.y();
  const float inverse_z = projected.z();
  const float xx = (R(2, 0) * u - R(0, 0)) * inverse_z;
  const float xy = fx_over_fy * (R(2, 1) * u - R(0, 1)) * inverse_z;
  const float yx = (R(2, 0) * v - R(1, 0)) * inverse_z / fx_over_fy;
  const float yy = (R(2, 1) * v - R(1, 1)) * inverse_z;
  geometry.x[kLaneCamera + 0] = kScale * (u + ray.x() * xx);
  geometry.x[kLaneCamera + 1] = kScale * ray.y() * xy;
  geometry.x[kLaneCamera + 2] = kScale * (1 + xx);
  geometry.x[kLaneCamera + 3] = kScale * xy;
  geometry.y[kLaneCamera + 0] = kScale * ray.x() * yx;
  geometry.y[kLaneCamera + 1] = kScale * (v + ray.y() * yy);
  geometry.y[kLaneCamera + 2] = kScale * yx;
  geometry.y[kLaneCamera + 3] = kScale * (1 + yy);
}

}  // namespace

bool evaluateGeometry(const WindowPoint& point,
                      const PairGeometry& pair,
                      const PinholeCamera& camera,
                      bool with_camera,
                      ResidualGeometry& geometry) {
  const auto fx = static_cast<float>(camera.fx);
  const auto fy = static_cast<float>(camera.fy);
  const Eigen::Vector3f ray((point.pixel.x() - static_cast<float>(camera.cx)) / fx,
                            (point.pixel.y() - static_cast<float>(camera.cy)) / fy,
                            1);
  const Eigen::Vector3f& t = pair.t_first;
  const Eigen::Vector3f p = pair.R_first * ray + t * point.inverse_depth;
  if (!(p.z() > 0)) return false;
  const float inverse_z = 1 / p.z();
  const float u = p.x() * inverse_z;
  const float v = p.y() * inverse_z;
  const float rho = point.inverse_depth * inverse_z;
  const float rows_x[] = {rho, 0, -rho * u, -u * v, 1 + u * u, -v};
  const float rows_y[] = {0, rho, -rho * v, -(1 + v * v), u * v, u};
  for (std::size_t i = 0; i < 6; ++i) {
    geometry.x[i] = fx * rows_x[i];
    geometry.y[i] = fy * rows_y[i];
  }
  geometry.depth_x = fx * (t.x() - t.z() * u) * inverse_z;
  geometry.depth_y = fy * (t.y() - t.z() * v) * inverse_z;
  if (with_camera) addCameraRows(ray, {u, v, inverse_z}, pair, fx / fy, geometry);
  return true;
}

}  // namespace dsorb::window
