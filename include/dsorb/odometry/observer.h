// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/init/initializer.h"

#include <Eigen/Core>

#include <optional>
#include <vector>

namespace dsorb {

enum class OdometryState { kInitializing, kInitialized, kTracked, kLost };

/// Name as in frames.csv, for example "tracked".
[[nodiscard]] const char* name(OdometryState state);

/// What is known of one frame after it was processed.
struct FrameEstimate {
  FramePtr frame;
  OdometryState state = OdometryState::kInitializing;  ///< after this frame
  int segment = 0;                  ///< a new one begins with the frame after a loss
  bool is_keyframe = false;         ///< or becomes one soon, where mapping has a thread of its own
  std::optional<SE3> T_world_cam;   ///< world: reference camera of the segment's initialization
  std::optional<FrameId> keyframe;  ///< it was tracked against; of an initialization: itself ...
  std::optional<SE3> T_cam_keyframe;  ///< ... and the pose relative to that, before any adjustment
  AffineBrightness affine;
  std::optional<double> tracking_rmse;  ///< level 0 [grey levels]
};

struct MapPoint {
  Eigen::Vector2f pixel{0, 0};  ///< in the keyframe, level 0 [px]
  float inverse_depth = 0;      ///< [1/unit]
  float variance = 0;           ///< [1/unit^2]
  float intensity = 0;          ///< [grey levels]
};

/// A keyframe with the points it hosts, as a value.
struct KeyframeSnapshot {
  FrameId id;
  double timestamp = 0;  ///< [s]
  int segment = 0;
  SE3 T_world_cam;
  AffineBrightness affine;
  PinholeCamera camera;
  std::vector<MapPoint> points;
};

/// Why a start was taken back during its probation.
enum class RollbackReason {
  kResidual,  ///< the adjustment of one of its first keyframes leaves too much
  kLost       ///< tracking or an adjustment broke down before it was proven
};

/// Name as in initialization.json, for example "residual".
[[nodiscard]] const char* name(RollbackReason reason);

/// A start that was taken back: nothing told of its segment holds any more, and its frames but the
/// reference go to the initializer again.
struct InitializationRollback {
  FrameId frame;  ///< the newest one given
  int segment = 0;
  RollbackReason reason = RollbackReason::kResidual;
  int keyframes = 0;  ///< since the start, which counts as two, at the last adjustment
  double rms = 0;     ///< of a pixel's residual after it [grey levels]
  double limit = 0;   ///< it had to keep to [grey levels]
};

/// Told what happens, in order, by Odometry::process, restart or finish and on their thread, also
/// where mapping has a thread of its own. Be quick; an exception propagates to the caller. Order of
/// a frame: onInitStep, onKeyframeRetired, onKeyframe of the whole window, onFrame. Of a lost one:
/// onFrame, onKeyframeRetired, onLost. Pipelined, onKeyframe and onKeyframeRetired come with a
/// later frame, before what that frame itself brings; they tell of the estimates by then.
class OdometryObserver {
 public:
  virtual ~OdometryObserver() = default;
  /// After every frame given to the initializer.
  virtual void onInitStep(const InitStep& /*step*/, const Frame& /*frame*/, int /*segment*/) {}
  /// After every frame; poses of frames before an initialization come with its result.
  virtual void onFrame(const FrameEstimate& /*estimate*/) {}
  /// A keyframe is new or its estimates changed.
  virtual void onKeyframe(const KeyframeSnapshot& /*keyframe*/) {}
  /// The keyframe's estimates are final.
  virtual void onKeyframeRetired(const KeyframeSnapshot& /*keyframe*/) {}
  /// A start failed its probation; onInitStep of its frames follows, in the same segment.
  virtual void onInitializationRollback(const InitializationRollback& /*rollback*/) {}
  virtual void onLost(FrameId /*frame*/, int /*segment*/) {}
};

}  // namespace dsorb
