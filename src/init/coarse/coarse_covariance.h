// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "init/coarse/coarse_handover.h"

#include <optional>
#include <vector>

namespace dsorb::init_coarse {

/// Uncertainty of one aligned frame, unit: the mean inverse depth of the good points is fixed.
struct Uncertainty {
  Matrix6d pose;                      ///< of exp(xi) T, [translation; rotation]
  std::vector<double> inverse_depth;  ///< variance a point of level 0; 0 where nothing is known
};

/// Covariance of pose and inverse depths together. Neighbouring patterns overlap, and errors of the
/// smoothed inverse depths are common to many points: on the pose, n good points carry the
/// information of `effective_points` independent ones; 0: all of theirs.
/// @param points    level 0, trial inverse depths the ones to judge at
/// @param curvature of each inverse depth known from another frame [grey levels^2 unit^2]; empty:
///                  this frame alone tells them
/// @return nothing where the frame does not determine the pose
/// @source inverse of the Gauss-Newton system with the inverse depths eliminated; effective points
///         as in init/orb/geometric_covariance
[[nodiscard]] std::optional<Uncertainty> uncertaintyOf(const Attempt& attempt,
                                                       const TrackedFrame& tracked,
                                                       PointLevel& points,
                                                       const std::vector<float>& curvature,
                                                       LevelAligner& aligner);

}  // namespace dsorb::init_coarse
