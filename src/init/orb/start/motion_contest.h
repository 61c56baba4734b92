// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"

#include "init/orb/map/attempt_types.h"
#include "init/orb/start/motion_candidates.h"
#include "init/orb/tracks/corner_tracks.h"
#include "init/orb/two_view/essential_motion.h"
#include "init/orb/two_view/model_selection.h"

#include <Eigen/Geometry>

#include <optional>
#include <vector>

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

/// Motions that the attempt before could not exclude, as the newest frame sees them.
/// @param R_cur_ref of the newest frame, nearly: all motions share the rotation since then
std::vector<EssentialMotion> carriedOver(const AttemptSummary& last,
                                         const Eigen::Quaterniond& R_cur_ref,
                                         const Matches& matches,
                                         const PinholeCamera& camera);

/// What all frames say of motions elsewhere.
struct RivalVerdict {
  double probability = 0;    ///< that the best of them is the right one
  std::vector<SE3> motions;  ///< the one they were compared with and they
};

/// Lets motions that fit the newest frame compete with a candidate over all frames since the
/// reference: two views of a plane, or with little parallax, allow several motions, more views need
/// not.
/// @param rivals  of the newest frame; the signs of their translations are open
/// @param samples     independent ones among the corners
/// @source docs/experiments.md, "When to start"
RivalVerdict judgeRivals(const std::vector<SE3>& rivals,
                         const MotionCandidate& own,
                         double samples,
                         const ReferenceView& view,
                         const AttemptContext& context);

}  // namespace dsorb::init_orb
