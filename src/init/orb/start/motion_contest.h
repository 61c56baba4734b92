// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "features/corner_tracks.h"
#include "init/orb/map/attempt_types.h"
#include "init/orb/start/motion_candidates.h"
#include "two_view/essential_motion.h"
#include "two_view/model_selection.h"

#include <optional>

namespace dsorb::init_orb {

/// A motion between two views, and how well its model explains the matches.
struct SelectedMotion {
  EssentialMotion motion;
  double noise = 0;  ///< of a match [px]
  double gric = 0;
};

/// The best motion after the motions of a plane have been tried as well.
struct PlaneComparison {
  MotionCandidate best;
  DisplacementModel model = DisplacementModel::kEssential;
  std::optional<double> homography_gric;  ///< over that of the essential matrix
  std::optional<double> second_cost;      ///< of the best really different motion, over the best's
  bool replaced = false;                  ///< a motion of the plane is the best now
};

/// Where a homography explains the matches better, both motions of the plane are tried.
void comparePlane(const SelectedMotion& selected,
                  const ReferenceView& view,
                  const Matches& matches,
                  const AttemptContext& context,
                  PlaneComparison& compared);

}  // namespace dsorb::init_orb
