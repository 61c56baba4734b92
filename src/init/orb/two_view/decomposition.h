// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/geometry/se3.h"

#include "geometry/triangulate.h"
#include "init/orb/tracks/corner_tracks.h"

#include <optional>
#include <vector>

namespace dsorb::init_orb {

/// Standard deviation of a corner's position in each image, for the models of two views [px].
constexpr double kCornerSigma = 1;

/// One possible motion with the structure it implies.
struct MotionHypothesis {
  SE3 T_cur_ref;                                         ///< translation of length 1
  std::vector<std::optional<TriangulatedPoint>> points;  ///< one a match; set where it is good
  int good = 0;                                          ///< good points among those counted
  double parallax_deg = 0;                               ///< that 51 of them reach
};

/// Motions that a homography allows (up to four), translations of length 1. Empty for a rotation.
std::vector<SE3> decomposeHomography(const Eigen::Matrix3d& H_cur_ref, const PinholeCamera& camera);
/// The four motions that an essential matrix allows, translations of length 1.
std::vector<SE3> decomposeEssential(const Eigen::Matrix3d& E);
/// The four motions that a fundamental matrix allows, translations of length 1.
std::vector<SE3> decomposeFundamental(const Eigen::Matrix3d& F, const PinholeCamera& camera);

/// Triangulates matches under a motion and keeps the good ones: in front of both cameras and within
/// two sigma of the measured position. (The position in the reference is exact: there the point is
/// hosted.)
/// @param counted one a match: whether it counts for `good` and the parallax
MotionHypothesis evaluateMotion(const SE3& T_cur_ref,
                                const Matches& matches,
                                const std::vector<char>& counted,
                                const PinholeCamera& camera);

}  // namespace dsorb::init_orb
