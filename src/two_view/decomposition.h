// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/geometry/se3.h"

#include "features/corner_tracks.h"
#include "geometry/triangulate.h"

#include <optional>
#include <vector>

namespace dsorb {

/// One possible motion with the structure it implies.
struct MotionHypothesis {
  SE3 T_cur_ref;                                         ///< translation of length 1
  std::vector<std::optional<TriangulatedPoint>> points;  ///< one a match; set where it is good
};

/// Motions that a homography allows (up to four), translations of length 1. Empty for a rotation.
std::vector<SE3> decomposeHomography(const Eigen::Matrix3d& H_cur_ref, const PinholeCamera& camera);
/// The four motions that an essential matrix allows, translations of length 1.
std::vector<SE3> decomposeEssential(const Eigen::Matrix3d& E);

}  // namespace dsorb
