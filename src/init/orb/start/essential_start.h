// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/init/initializer.h"
#include "dsorb/options/orb.h"

#include "init/orb/map/attempt_types.h"
#include "two_view/essential_motion.h"
#include "two_view/model_selection.h"

#include <Eigen/Core>

#include <optional>
#include <vector>

namespace dsorb::init_orb {

/// Median error of an inverse depth, relative to the larger of itself and that of the scene's near
/// part, which a quarter of the corners exceeds: a background far away need not be known as well as
/// its own distance.
double depthSigma(const std::vector<Corner>& corners);

/// How much larger the errors are than the images' noise explains: at least 1.
/// @param median_error of the corners, whitened by their covariances [-]
double misfitOf(double median_error);

/// Whether a map has enough corners for a start: of tracks by optical flow half, as others
/// contradict the motion; of matches a part is wrong anyway.
bool hasEnoughCorners(const InitialMap& map, const LiveTracks& live);

/// What the errors of a start are multiplied by for live tracks that it does not explain: 1 where
/// it explains half of them, in proportion more where fewer.
double lostTracksFactor(const InitialMap& map, const LiveTracks& live);

/// What is known of a start beside its map.
struct StartEvidence {
  LiveTracks live;                         ///< of the reference
  double front_share = 0;                  ///< of the corners, in front of the camera
  double misfit = 1;                       ///< misfitOf the refined corners; covariances have it
  std::optional<double> plane_cost_ratio;  ///< of the other motion of a plane
};

/// Judges a start.
/// @param map refined, mean inverse depth 1, with covariances
GateReport judgeStart(const InitialMap& map,
                      const PinholeCamera& camera,
                      const GateOptions& options,
                      const StartEvidence& evidence);

/// Whether a start would pass by its errors alone if they had shrunk by a factor.
bool errorsPass(const GateReport& report, double shrunk_by, const GateOptions& options);

/// Probability that a start is wrong if its errors had shrunk by a factor.
double wrongProbability(const GateReport& report, double shrunk_by, const GateOptions& options);

/// Cells of the image with corners in them.
int occupiedCells(const InitialMap& map, const PinholeCamera& camera);

/// A motion with the map that follows from it, adjusted over a few frames.
struct MotionCandidate {
  InitialMap map;
  int live_tracks = 0;     ///< that a corner could have been made of
  double front_share = 0;  ///< of the corners, in front of the camera
  double cost = 0;         ///< mean robust cost of all tracks in these frames, lost corners at the
                           ///< cost of the severe limit
  /// Sums of the tracks in each of errorCells(), then what is known beside the tracks.
  std::vector<double> cell_costs{};
  std::optional<bool> motions_used{};  ///< that the caller knows; none: none are known
};

/// Triangulates the motion's inliers, poses a few frames and adjusts all.
/// @return nullopt when too few corners are left
std::optional<MotionCandidate> makeCandidate(const ReferenceView& view,
                                             const EssentialMotion& motion,
                                             const AttemptContext& context);

/// Motions that a homography of the images allows, with most of what each explains in front of both
/// cameras: two at most. Translations of length 1.
std::vector<EssentialMotion> planeMotions(const Eigen::Matrix3d& H_cur_ref,
                                          const Matches& matches,
                                          const PinholeCamera& camera);

/// Cost of a candidate over that of another one. Each cell of the image says only so much of the
/// difference, as neighbours err together: along a border that moves with the camera, or where
/// tracks are lost.
double costRatio(const MotionCandidate& other, const MotionCandidate& best);

/// Outcome of a competition between motions.
struct Competition {
  double cost_ratio = 1;  ///< of the best candidate with another motion over the best, or infinite
  bool replaced = false;  ///< the best has another motion than the one that was there before
};

/// Lets motions compete with a candidate: the tracks of all its frames decide.
/// @param best in: candidate found without them; out: the best by costRatio()
Competition competeOverFrames(const ReferenceView& view,
                              const std::vector<EssentialMotion>& motions,
                              const AttemptContext& context,
                              MotionCandidate& best);

/// One try to initialize.
struct Attempt {
  Outcome<Reconstruction> made = InitReason::kSettling;
  AttemptSummary summary;                 ///< for the next one from this reference
  std::optional<WaitingMotion> motion{};  ///< of a start that was judged and did not pass
};

/// Poses and corners from the essential matrix: robust adjustment of a few frames, a gate on the
/// predicted error of the direction of translation, the tracks' noise measured, corners refined by
/// aligning warped patches. Only the adjusted frames are posed.
Attempt startFromEssential(const ReferenceView& view, const AttemptContext& context);

}  // namespace dsorb::init_orb
