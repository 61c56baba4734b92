// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/init/result.h"
#include "dsorb/options/odometry.h"

#include "geometry/motion_prior.h"
#include "geometry/recent_motion.h"
#include "track/motion_guesses.h"
#include "track/tracker.h"

#include <optional>

namespace dsorb::odometry {

/// Where a keyframe is after its adjustment.
struct KeyframePose {
  FramePtr frame;
  SE3 T_cam_world;
  AffineBrightness affine;
  std::optional<Matrix6d>
      covariance{};  ///< of exp(xi) * T_cam_world: WindowUncertainty::newest_pose
  double reach = 0;  ///< distance of the farthest keyframe that its map was made with [unit]
};

/// What frames are tracked against, as a value.
struct TrackingTarget {
  KeyframePose keyframe;
  track::TrackingReference reference;  ///< of the keyframe
  SE3 T_cam_previous;  ///< relative to the target before it, as tracked; unused for the first one
};

struct TrackedPose {
  bool good = false;  ///< else only `rmse` has a meaning
  FrameId keyframe;   ///< the target
  SE3 T_cam_keyframe;
  std::optional<Matrix6d> covariance;  ///< of exp(xi) * T_cam_keyframe, [translation; rotation]
  SE3 T_cam_world;
  std::optional<Matrix6d> world_covariance;  ///< of exp(xi) * T_cam_world, in the window's gauge
  AffineBrightness affine;
  std::optional<double> rmse;   ///< level 0 [grey levels]
  bool wants_keyframe = false;  ///< the target is too far away
  RowMotion motion;             ///< of the frame while its rows are read, as its image shows it
  MotionPrior rows;             ///< as the frames before it let expect
  FrameId previous;             ///< frame tracked before
  MotionPrior previous_rows;    ///< of that one, now that its successor is known
};

/// Frame by frame tracking against the newest target: remembers the motion, knows when a new
/// keyframe is due. Knows neither the map nor observers.
class FrameTracker {
 public:
  explicit FrameTracker(const OdometryOptions& options);

  /// Starts with the motion of an initialization; its newest frame is the first target to come.
  void begin(const InitializationResult& result);
  /// Later frames are tracked against this keyframe.
  void setTarget(TrackingTarget target);
  [[nodiscard]] TrackedPose track(const Frame& frame);
  /// The keyframe that frames are tracked against; there is one after setTarget().
  [[nodiscard]] const KeyframePose& target() const { return *target_; }

 private:
  /// The poses that a map was made with and its depths err together. A frame at a share of their
  /// distance errs by that share of what its keyframe does in its window, and both add up.
  /// docs/experiments.md, "Covariance of tracked poses"
  void addErrorsOfMap(TrackedPose& pose) const;
  [[nodiscard]] bool needsKeyframe(const Frame& frame, const track::TrackingResult& result) const;

  OdometryOptions options_;
  track::Tracker tracker_;
  std::optional<KeyframePose> target_;
  track::MotionHistory history_;      // relative to the target
  RecentMotion recent_;               // relative to the target
  FrameId previous_;                  // frame
  AffineBrightness affine_;           // of the previous frame
  double rmse_ = 0;                   // of the previous frame, level 0 [grey levels]
  std::optional<double> first_rmse_;  // of the first frame tracked against the target
};

}  // namespace dsorb::odometry
