// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/init/result.h"

#include "init/orb/map/attempt_types.h"
#include "init/orb/thesis/two_view.h"
#include "init/orb/two_view/decomposition.h"

#include <cstdint>

namespace dsorb::init_orb {

/// The motion between two views, or the reason why there is none yet.
struct TwoViewMotion {
  InitReason reason = InitReason::kDegenerateMotion;  ///< kDone when a motion was found
  TwoViewModel model = TwoViewModel::kFundamental;
  double homography_score = 0;
  double fundamental_score = 0;
  int inliers = 0;      ///< of the chosen model
  int second_good = 0;  ///< good points of the second-best motion
  MotionHypothesis best;
};

/// Fits both models, chooses one, decomposes it and chooses the motion that most points confirm.
/// @param matches at least eight
/// @source Mur-Artal, Montiel, Tardos, ORB-SLAM, arXiv:1502.00956, section IV; [Gladkova],
/// section 3.2
TwoViewMotion estimateMotion(const Matches& matches,
                             const PinholeCamera& camera,
                             ModelChoice choice,
                             std::uint64_t seed);

/// Poses and corners from two views: homography against fundamental matrix between the reference
/// and the newest frame, then the poses of the frames between.
/// @source [Gladkova], section 3.2
Outcome<Reconstruction> startFromTwoViews(const ReferenceView& view, const AttemptContext& context);

/// Adjusts poses and corners of such a start.
Outcome<Reconstruction> adjustCorners(Reconstruction made, const AttemptContext& context);

}  // namespace dsorb::init_orb
