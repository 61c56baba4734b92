// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/geometry/se3.h"

#include <Eigen/Core>

#include <optional>

namespace dsorb {

/// Inverse depth along a ray of the host camera, with its variance.
struct TriangulatedPoint {
  double inverse_depth = 0;  ///< [1/unit]; 0 is infinity, negative lies behind the host
  double variance = 0;       ///< [1/unit^2]
};

/// Inverse depth of a host pixel from its position in a second image, in closed form; the host
/// pixel is exact, the target's is measured.
/// @param T_target_host  maps host to target camera coordinates
/// @param host_ray       ray of the host pixel with z = 1
/// @param target         measured position in the target, normalised: (u, v) at z = 1
/// @param sigma          of each measured coordinate, in the same normalised units
/// @return               nullopt where the measurement says nothing: at the epipole or without
///                       translation
/// @source               least squares of u' (r3 + rho t3) = r1 + rho t1 and its v' row, with
///                       r = R host_ray; the variance is sigma^2 over the squared derivative of the
///                       projection by rho
std::optional<TriangulatedPoint> triangulateInverseDepth(const SE3& T_target_host,
                                                         const Eigen::Vector3d& host_ray,
                                                         const Eigen::Vector2d& target,
                                                         double sigma);

/// Angle under which two cameras see a point.
/// @param host_ray, target_ray rays in their own cameras, of any length
/// @return angle between the rays after turning both into the target's axes [rad]
double parallaxAngle(const SE3& T_target_host,
                     const Eigen::Vector3d& host_ray,
                     const Eigen::Vector3d& target_ray);

}  // namespace dsorb
