// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/geometry/se3.h"

#include <Eigen/Core>

#include <optional>

namespace dsorb {

/// Pixel of a hosted point in another camera with its derivatives.
struct HostedProjection {
  Eigen::Vector2d pixel;               ///< [px]
  Eigen::Matrix<double, 2, 6> J_pose;  ///< of a left increment, [translation; rotation]
  Eigen::Vector2d J_inverse_depth;     ///< [px unit]
};

/// Projects the point at inverse depth `rho` on a host ray.
/// @param T_cam_host  maps host to camera coordinates
/// @param host_ray    ray with z = 1
/// @param rho         inverse depth in the host [1/unit]
/// @return            nullopt unless the point lies in front of the camera
/// @source            derived in triangulate_test; p = R ray + rho t is the point times rho, so
///                    infinity (rho = 0) needs no special case
inline std::optional<HostedProjection> projectHosted(const PinholeCamera& camera,
                                                     const SE3& T_cam_host,
                                                     const Eigen::Vector3d& host_ray,
                                                     double rho) {
  constexpr double kMinZ = 1e-6;  // of p, whose z is 1 without motion
  const Eigen::Vector3d& t = T_cam_host.translation();
  const Eigen::Vector3d p = T_cam_host.unitQuaternion() * host_ray + rho * t;
  if (!(p.z() > kMinZ)) return std::nullopt;
  const double inverse_z = 1.0 / p.z();
  const double u = p.x() * inverse_z;
  const double v = p.y() * inverse_z;
  const double scaled_rho = rho * inverse_z;
  HostedProjection out;
  out.pixel = {camera.fx * u + camera.cx, camera.fy * v + camera.cy};
  out.J_pose << scaled_rho, 0, -scaled_rho * u, -u * v, 1 + u * u, -v,  //
      0, scaled_rho, -scaled_rho * v, -(1 + v * v), u * v, u;
  out.J_pose.row(0) *= camera.fx;
  out.J_pose.row(1) *= camera.fy;
  out.J_inverse_depth = {camera.fx * (t.x() - u * t.z()) * inverse_z,
                         camera.fy * (t.y() - v * t.z()) * inverse_z};
  return out;
}

}  // namespace dsorb
