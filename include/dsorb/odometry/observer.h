// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/image/map_point.h"
#include "dsorb/init/initializer.h"

#include <Eigen/Core>

#include <optional>
#include <vector>

namespace dsorb {

enum class OdometryState { kInitializing, kInitialized, kTracked, kLost };

/// Name as in frames.csv, for example "tracked".
[[nodiscard]] const char* name(OdometryState state);

/// Estimate of one frame after it was processed.
struct FrameEstimate {
  FramePtr frame;
  OdometryState state = OdometryState::kInitializing;  ///< after this frame
  int segment = 0;                    ///< number; a new one begins with the frame after a loss
  bool is_keyframe = false;           ///< or will become one, where mapping has its own thread
  std::optional<SE3> T_world_cam;     ///< world: reference camera of the segment's initialization
  std::optional<FrameId> keyframe;    ///< that it was tracked against, or itself after initializing
  std::optional<SE3> T_cam_keyframe;  ///< pose relative to that keyframe, before any adjustment
  AffineBrightness affine;
  std::optional<double> tracking_rmse;  ///< level 0 [grey levels]
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

/// Reason why a start was taken back during its probation.
enum class RollbackReason {
  kResidual,  ///< the adjustment of one of its first keyframes left too large a residual
  kLost       ///< tracking or an adjustment broke down before it was proven
};

/// Name as in initialization.json, for example "residual".
[[nodiscard]] const char* name(RollbackReason reason);

/// A start that was taken back. Everything told of its segment is void, and its frames except the
/// reference are given to the initializer again.
struct InitializationRollback {
  FrameId frame;  ///< the newest frame given so far
  int segment = 0;
  RollbackReason reason = RollbackReason::kResidual;
  int keyframes = 0;  ///< at the last adjustment; the start itself counts as two
  double rms = 0;     ///< of the residuals after that adjustment [grey levels]
  double limit = 0;   ///< of that rms [grey levels]
};

/// Is told by Odometry::process, restart and finish what happens, in order and on their thread,
/// also where mapping has a thread of its own. Calls should be quick; exceptions propagate to the
/// caller. The order for a frame is onInitStep, onKeyframeRetired, onKeyframe of the whole window,
/// onFrame; for a lost one it is onFrame, onKeyframeRetired, onLost. When pipelined, onKeyframe and
/// onKeyframeRetired come with a later frame, before its own calls, with the estimates of that
/// time.
class OdometryObserver {
 public:
  virtual ~OdometryObserver() = default;
  /// Called after every frame given to the initializer.
  virtual void onInitStep(const InitStep& /*step*/, const Frame& /*frame*/, int /*segment*/) {}
  /// Called after every frame; poses of frames before an initialization come with its result.
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
