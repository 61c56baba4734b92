// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "init/orb/map/attempt_types.h"
#include "two_view/essential_motion.h"
#include "two_view/model_selection.h"

#include <Eigen/Core>

#include <optional>
#include <vector>

namespace dsorb::init_orb {

/// A motion with the map that follows from it, adjusted over a few frames.
struct MotionCandidate {
  InitialMap map;
  double front_share = 0;  ///< of the corners, in front of the camera
  double cost = 0;         ///< mean robust cost of all tracks in these frames, lost corners at the
                           ///< cost of the severe limit
  std::optional<bool> motions_used{};  ///< that the caller knows; none: none are known
};

/// Triangulates the motion's inliers, poses a few frames and adjusts all.
/// @return nullopt when too few corners are left
std::optional<MotionCandidate> makeCandidate(const ReferenceView& view,
                                             const EssentialMotion& motion,
                                             const AttemptContext& context);

/// Motions that a homography of the images allows, with most of its inliers in front of both
/// cameras: two at most. Translations of length 1.
std::vector<EssentialMotion> planeMotions(const Eigen::Matrix3d& H_cur_ref,
                                          const Matches& matches,
                                          const PinholeCamera& camera,
                                          double threshold);

/// Outcome of a competition between motions.
struct Competition {
  double cost_ratio = 1;  ///< of the best candidate with another motion over the best, or infinite
  bool replaced = false;  ///< the best has another motion than the one that was there before
};

/// Lets motions compete with a candidate: the tracks of all its frames decide.
/// @param best in: candidate found without them; out: the one of least cost
Competition competeOverFrames(const ReferenceView& view,
                              const std::vector<EssentialMotion>& motions,
                              const AttemptContext& context,
                              MotionCandidate& best);

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
