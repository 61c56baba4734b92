// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/calibration.h"
#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/geometry/similarity.h"
#include "dsorb/image/map_point.h"
#include "dsorb/init/initializer.h"
#include "dsorb/init/start_judge.h"

#include <array>
#include <optional>
#include <vector>

namespace dsorb {

/// State of an odometry after a frame.
enum class OdometryState {
  kInitializing,  ///< there is no map yet
  kInitialized,   ///< the map begins with this frame
  kTracked,       ///< the frame has a pose
  kLost,          ///< the map is given up; the next frame needs Odometry::restart()
  kMissed,        ///< the frame has no pose; the map stands, the next frame is tried
};

/// Name as in frames.csv, for example "tracked".
[[nodiscard]] const char* name(OdometryState state);

/// Estimate of one frame after it was processed.
struct FrameEstimate {
  FramePtr frame;                                      ///< the frame that was processed
  OdometryState state = OdometryState::kInitializing;  ///< after this frame
  int segment = 0;                    ///< number; a new one begins with the frame after a loss
  bool is_keyframe = false;           ///< or will become one, where mapping has its own thread
  std::optional<SE3> T_world_cam;     ///< world: reference camera of the segment's initialization
  std::optional<FrameId> keyframe;    ///< target of its tracking, or itself after initializing
  std::optional<SE3> T_cam_keyframe;  ///< pose relative to that keyframe, before any adjustment
  /// Covariance of xi = [translation; rotation] in exp(xi) * T_cam_keyframe, in the segment's unit
  /// and in rad, where the frame was tracked and its points determine it. How sure the keyframe's
  /// own pose is, it does not say.
  std::optional<Matrix6d> covariance;
  /// Covariance of xi in exp(xi) * T_cam_world as tracked, in the same units. The errors of the
  /// keyframe's pose relative to the other keyframes of its window are in it; the drift of the
  /// window as a whole (its place, direction and scale) is not. Both covariances grow where the
  /// window suspects the calibration (KeyframeSnapshot::camera_score).
  std::optional<Matrix6d> world_covariance;
  AffineBrightness affine;              ///< as brightnessTransfer() takes it
  std::optional<double> tracking_rmse;  ///< level 0 [grey levels]
  std::optional<FrameId> repeats;       ///< earlier frame with the same image, whose answer this is
};

/// A keyframe with the points it hosts, as a value.
struct KeyframeSnapshot {
  FrameId id;                        ///< id of its frame
  double timestamp = 0;              ///< [s]
  int segment = 0;                   ///< segment that it belongs to
  SE3 T_world_cam;                   ///< world: reference camera of the segment's initialization
  AffineBrightness affine;           ///< as brightnessTransfer() takes it
  PinholeCamera camera;              ///< camera of pixels, poses and depths; as refined, if it is
  std::vector<MapPoint> points;      ///< points it hosts, those that left the adjustment included
  std::optional<Readout> readout{};  ///< estimated, where Lens::readout has a sigma
  /// Standard deviations of fx, fy, cx, cy where the window estimates them [px].
  std::optional<std::array<double, 4>> camera_sigmas{};
  /// Distortion that the images have beside `camera`; estimated where the camera is a guess
  /// (PriorOptions::focal_sigma).
  std::optional<RadialDistortion> radial{};
  /// What contradicted the calibration most among the first keyframes of the segment, where the
  /// window does not estimate the camera.
  std::optional<CameraScore> camera_score{};
};

/// A start that the first adjustment of the window contradicts. The result that onInitStep told is
/// void: the initializer begins anew with the next frame.
struct StartRefusal {
  FrameId frame;                                      ///< the newest frame of the start
  int segment = 0;                                    ///< number; the next start keeps it
  RefusalReason reason = RefusalReason::kAdjustment;  ///< the first that applies
  StartChange change;                                 ///< zeros with kAdjustment
};

/// Two segments that have become one (dsorb/place/place.h): what was told of one of them is to be
/// brought into the world and the unit of the other.
struct SegmentsJoined {
  int segment = 0;                         ///< the one that is moved
  int into = 0;                            ///< the one whose world and unit stay
  Similarity S_into_segment;               ///< of the worlds
  Matrix7d covariance = Matrix7d::Zero();  ///< of a left increment of it
  int keyframes = 0;                       ///< of the moved one, that were seen to show the other
  int matches = 0;                         ///< corners that agree with it
  double wrong_probability = 1;            ///< that they are two places
};

/// A keyframe that loops have moved: its points and the frames that hang on it move along.
struct KeyframeMoved {
  FrameId id;            ///< id of its frame
  Similarity S_new_old;  ///< worlds of its segment: coordinates around it of before to those now
};

/// Places of a segment that were seen again, and what followed.
struct LoopsClosed {
  int segment = 0;                   ///< after all joins
  int loops = 0;                     ///< that were taken
  std::vector<KeyframeMoved> moved;  ///< all keyframes of the segment
};

/// Where a keyframe sees a point.
struct TrackSight {
  FrameId keyframe;             ///< id of its frame
  Eigen::Vector2f pixel{0, 0};  ///< in its rectified image [px]
};

/// A corner that was followed through several keyframes, and triangulated.
struct MapTrack {
  int segment = 0;                    ///< after all joins
  Eigen::Vector3d position{0, 0, 0};  ///< in the world of the segment, after all loops
  std::vector<TrackSight> sights;     ///< two or more
};

/// Is told by Odometry::process, restart and finish what happens, in order and on their thread,
/// also where mapping has a thread of its own. Calls should be quick; exceptions propagate to the
/// caller, and a result that onInitStep told is void then, as after onStartRefused. The order for a
/// frame is onInitStep, onKeyframeRetired, onKeyframe of the whole window, onFrame; for a start
/// that is refused onInitStep, onStartRefused, onFrame; for a lost frame onFrame,
/// onKeyframeRetired, onLost. When pipelined, onKeyframe and onKeyframeRetired come with a later
/// frame, before its own calls, with the estimates of that time.
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
  /// The window refused the result of the onInitStep before; the segment stays.
  virtual void onStartRefused(const StartRefusal& /*refusal*/) {}
  /// Tracking was lost with this frame; the next one needs Odometry::restart(). Without an onFrame
  /// before where it is restart() or finish() that finds the map broken.
  virtual void onLost(FrameId /*frame*/, int /*segment*/) {}
  /// Told by Place, not by Odometry: segments have become one.
  virtual void onSegmentsJoined(const SegmentsJoined& /*joined*/) {}
  /// Told by Place, after all onSegmentsJoined.
  virtual void onLoopsClosed(const LoopsClosed& /*closed*/) {}
  /// Told by Place at the end: what the keyframes of the run see in common.
  virtual void onTracks(const std::vector<MapTrack>& /*tracks*/) {}
};

}  // namespace dsorb
