// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/geometry/se3.h"

#include "init/orb/tracks/corner_tracks.h"

#include <cmath>
#include <vector>

namespace dsorb::init_orb {

/// How much worse the matches fit the best motion whose translation points elsewhere.
struct RivalMotion {
  double excess = 0;  ///< of its negative log likelihood over that of the motion asked about
  int matches = 0;    ///< that took part
  /// The best ones, apart from each other by that angle; translations of length 1, signs open.
  std::vector<SE3> motions{};

  /// That the rival is the right one, when only so many of the matches err independently.
  [[nodiscard]] double probability(double independent) const {
    return 1 / (1 + std::exp(excess * independent / matches));
  }
};

/// Searches all directions of translation that are farther than an angle from a motion's, the
/// rotation fitted to each. Errors are Sampson distances under a t-distribution. A direction and
/// its opposite have the same: which one it is, the depths decide.
/// @param T_cur_ref translation of any length but 0
/// @param sigma     of a match about its epipolar line [px]
RivalMotion findRival(const SE3& T_cur_ref,
                      const Matches& matches,
                      const PinholeCamera& camera,
                      double sigma,
                      double angle_deg);

}  // namespace dsorb::init_orb
