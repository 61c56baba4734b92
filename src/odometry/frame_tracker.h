// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/frame.h"
#include "dsorb/init/result.h"
#include "dsorb/options/odometry.h"

#include "features/pose_from_matches.h"
#include "geometry/motion_prior.h"
#include "geometry/recent_motion.h"
#include "track/tracker.h"
#include "track/tracking_reference.h"

#include <cstdint>
#include <optional>
#include <vector>

namespace dsorb::odometry {

/// A pose of a frame, and the matches with the keyframe that tell it.
struct MatchEvidence {
  std::vector<PointObservation> matches;
  MatchedPose pose;
};

/// Poses that matched corners of a frame and its keyframe tell, however far apart both are. The
/// corners of both are looked for when they are asked for.
class MatchedPoses {
 public:
  explicit MatchedPoses(std::uint64_t seed) : seed_(seed) {}

  /// Relative to the frame of a reference. @return nullopt where too few matches agree
  [[nodiscard]] std::optional<MatchEvidence> find(const FramePtr& frame,
                                                  const track::TrackingReference& reference);

 private:
  std::uint64_t seed_;
  FramePtr host_frame_;     // of the reference
  DescribedPoints points_;  // of the reference
  double mean_ = 0;         // intensity of the reference [grey levels]
  FramePtr frame_;          // asked for last
  DescribedFrame described_{};
};

/// Where a keyframe is after its adjustment.
struct KeyframePose {
  SE3 T_cam_world;
  std::optional<Matrix6d>
      covariance{};  ///< of exp(xi) * T_cam_world: WindowUncertainty::newest_pose
  std::optional<Matrix6d> covariance_camera_held{};  ///< WindowUncertainty::newest_pose_camera_held
  double reach = 0;    ///< distance of the farthest keyframe that its map was made with [unit]
  SE3 T_cam_middle{};  ///< relative to the middle one of those keyframes
  double doubt = 0;  ///< share by which the camera may get motions wrong, where it is suspected [-]
};

/// What frames are tracked against, as a value.
struct TrackingTarget {
  KeyframePose keyframe;
  track::TrackingReference reference;  ///< of the keyframe
  SE3 T_cam_previous;  ///< relative to the target before it, as tracked; unused for the first one
};

struct TrackedPose {
  bool good = false;  ///< else only `rmse` has a meaning
  bool fits = true;   ///< else the map must not learn from the frame
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
  /// @param may_doubt whether a frame whose residual has grown much may get no pose, or one without
  ///        `fits`
  [[nodiscard]] TrackedPose track(const FramePtr& frame, bool may_doubt = false);
  /// The keyframe that frames are tracked against; there is one after setTarget().
  [[nodiscard]] const KeyframePose& target() const { return *target_; }
  [[nodiscard]] const track::TrackingReference& reference() const { return tracker_.reference(); }

 private:
  [[nodiscard]] track::TrackingStart startOf(const Frame& frame) const;
  /// Whether a pose that the tracker has found by its own guesses counts.
  [[nodiscard]] bool counts(const Frame& frame,
                            const track::TrackingResult& result,
                            bool may_doubt) const;
  /// Whether matched corners of a frame far from its keyframe agree about another pose.
  [[nodiscard]] bool isContradicted(const FramePtr& frame, const track::TrackingResult& result);
  /// The pose that matched corners tell, aligned to the image; none where too few agree with it.
  [[nodiscard]] std::optional<track::TrackingResult> fromMatches(const FramePtr& frame);
  void setPose(const track::TrackingResult& result, TrackedPose& pose) const;
  /// The poses that a map was made with and its depths err together. A frame at a share of their
  /// distance errs by that share of what its keyframe does in its window, and both add up.
  void addErrorsOfMap(TrackedPose& pose) const;
  /// Whether the map itself knows the frame's rotation, whatever it leaves open of the camera.
  [[nodiscard]] bool isCertain(const track::TrackingResult& result) const;
  /// A focal length that is off by a share gets motions wrong by that share.
  void addErrorsOfCamera(TrackedPose& pose) const;
  [[nodiscard]] bool needsKeyframe(const Frame& frame, const track::TrackingResult& result) const;
  /// Residual in the contrast of the last frame that fitted, where that is lower [grey levels].
  [[nodiscard]] double inEarlierContrast(const Frame& frame,
                                         const track::TrackingResult& result) const;
  /// Whether the image fits about as well as the last one that did.
  [[nodiscard]] bool isAtLevel(const Frame& frame, const track::TrackingResult& result) const;
  /// Whether the image fits much worse than the one before, at a pose off the motion.
  [[nodiscard]] bool isDoubtful(const Frame& frame, const track::TrackingResult& result) const;
  void noteFit(const Frame& frame, const track::TrackingResult& result);
  void noteMotion(const Frame& frame, TrackedPose& pose);

  OdometryOptions options_;
  track::Tracker tracker_;
  std::optional<KeyframePose> target_;
  track::MotionHistory history_;  // relative to the target
  RecentMotion recent_;           // relative to the target
  FrameId previous_;              // frame
  MatchedPoses matched_;
  bool missed_ = false;  // a frame since the last one that fitted
  // What the last frame that fitted left behind.
  AffineBrightness affine_;
  double exposure_ = 1;                 // [s]
  double rmse_ = 0;                     // level 0 [grey levels]
  std::optional<double> largest_rmse_;  // of late [grey levels]
};

}  // namespace dsorb::odometry
