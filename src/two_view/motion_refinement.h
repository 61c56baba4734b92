// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/geometry/se3.h"

#include "features/corner_tracks.h"

#include <Eigen/Core>

#include <vector>

namespace dsorb {

/// Violation of the epipolar constraint by one match, with derivatives.
struct EpipolarResidual {
  double value = 0;               ///< x_t^T [t]x R x_r over the length of its image gradient
  Eigen::Matrix<double, 1, 5> J;  ///< of [rotation, left; t along tangentBasis(t)]
};

/// Sampson's distance of a match from the epipolar geometry of a motion, signed; the derivatives
/// hold its denominator fixed.
/// @param T_cur_ref translation of length 1
/// @param reference, target normalised rays, z = 1
/// @param basis        tangentBasis of the translation
/// @source Hartley and Zisserman, Multiple View Geometry, eq. (11.9); derivatives in
///         motion_hypotheses_test
EpipolarResidual epipolarResidual(const SE3& T_cur_ref,
                                  const Eigen::Vector3d& reference,
                                  const Eigen::Vector3d& target,
                                  const Eigen::Matrix<double, 3, 2>& basis);

/// Moves a motion to the minimum of Sampson's distance over the counted matches, with a Cauchy
/// loss. A linear model need not be an essential matrix: its decomposition is only near.
/// @param T_cur_ref translation of length 1
/// @param counted      one a match
/// @param sigma        of a corner's position, each axis [px]
/// @return             translation of length 1; the input where the equations are singular
SE3 refineMotion(const SE3& T_cur_ref,
                 const Matches& matches,
                 const std::vector<char>& counted,
                 const PinholeCamera& camera,
                 double sigma);

}  // namespace dsorb
