// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/geometry/se3.h"

#include <Eigen/Core>

namespace dsorb::init_orb {

/// Where a point of the reference, given by ray and inverse depth, is seen in another camera.
struct InverseDepthProjection {
  Eigen::Vector2d pixel{0, 0};
  double z = 0;  ///< of R ray + inverse_depth t: depth ratio target / reference; > 0 in front
  Eigen::Matrix<double, 2, 6> J_pose;     ///< [px] by left increment [translation; rotation]
  Eigen::Vector2d J_inverse_depth{0, 0};  ///< [px unit]
};

/// Projects and differentiates. Works through infinity: an inverse depth of 0 or below is nothing
/// special as long as `z` is positive.
/// @param R, t pose, maps the reference to the target camera
/// @param ray  in the reference, z = 1
/// @return `pixel` and Jacobians are meaningless unless `z` > 0
/// @source derived from u = (R ray + rho t)_x / z, v = (R ray + rho t)_y / z; checked numerically
///         in geometric_adjustment_test
inline InverseDepthProjection projectInverseDepth(const PinholeCamera& camera,
                                                  const Eigen::Matrix3d& R,
                                                  const Eigen::Vector3d& t,
                                                  const Eigen::Vector3d& ray,
                                                  double inverse_depth) {
  InverseDepthProjection result;
  const Eigen::Vector3d p = R * ray + inverse_depth * t;
  result.z = p.z();
  const double inverse_z = 1.0 / p.z();
  const double u = p.x() * inverse_z;
  const double v = p.y() * inverse_z;
  result.pixel = {camera.fx * u + camera.cx, camera.fy * v + camera.cy};
  const double target_inverse_depth = inverse_depth * inverse_z;
  result.J_pose << target_inverse_depth, 0, -target_inverse_depth * u, -u * v, 1 + u * u, -v,  //
      0, target_inverse_depth, -target_inverse_depth * v, -(1 + v * v), u * v, u;
  result.J_pose.row(0) *= camera.fx;
  result.J_pose.row(1) *= camera.fy;
  result.J_inverse_depth = {camera.fx * (t.x() - u * t.z()) * inverse_z,
                            camera.fy * (t.y() - v * t.z()) * inverse_z};
  return result;
}

}  // namespace dsorb::init_orb
