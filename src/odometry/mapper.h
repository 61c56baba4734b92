// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/init/result.h"
#include "dsorb/odometry/observer.h"
#include "dsorb/options/odometry.h"

#include "base/parallel.h"
#include "base/worker_queue.h"
#include "image/pixel_selector.h"
#include "image/stuck_regions.h"
#include "odometry/frame_tracker.h"
#include "window/window.h"
#include "window/window_optimizer.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <optional>
#include <vector>

namespace dsorb::odometry {

/// How much less sure an estimate is than the variances of its adjustments say. While it gathers
/// information it should move, from one adjustment to the next, with the difference of its
/// variances; where models do not hold it moves by more.
/// @source Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation,
///         section 5.4: normalised innovation squared
class InnovationScale {
 public:
  /// @param sigma as its adjustment says
  /// @return factor on sigma, at least 1
  double update(double value, double sigma) {
    if (sigma_ > 0) {
      const double variance = sigma_ * sigma_;
      const double gained = std::max(variance - sigma * sigma, kLeastGain * variance);
      squares_ += (value - value_) * (value - value_) / gained;
      ++count_;
    }
    value_ = value;
    sigma_ = sigma;
    return std::sqrt(std::max(1.0, (1 + squares_) / (1 + count_)));
  }

 private:
  static constexpr double kLeastGain = 0.05;  // of a variance: less is rounding

  double value_ = 0;
  double sigma_ = 0;
  double squares_ = 0;
  int count_ = 0;
};

/// A tracked frame on its way into the map.
struct MappingJob {
  FramePtr frame;
  TrackedPose pose;
  bool becomes_keyframe = false;
};

/// What a new keyframe made of the map, as values.
struct MapUpdate {
  int new_keyframes = 0;  ///< one, or those of an initialization
  /// Whether the adjustment did its work; else nothing below is valid: it broke down or used no
  /// residual.
  bool finite = false;
  StartChange start_change;               ///< of a seed
  TrackingTarget target;                  ///< the newest keyframe
  std::vector<KeyframeSnapshot> retired;  ///< left the window, oldest first
  std::vector<KeyframeSnapshot> window;   ///< oldest first
};

/// Owner of the window: takes over an initialization, refines candidates with tracked frames, adds
/// keyframes. Knows neither the tracker nor observers.
class Mapper {
 public:
  Mapper(const PinholeCamera& camera, const OdometryOptions& options);

  /// Starts a new window from an initialization and adjusts it.
  /// @param segment of its keyframes
  [[nodiscard]] MapUpdate seed(const InitializationResult& result, int segment);
  /// Searches all candidates in a tracked frame. The frame may become a keyframe: then the window
  /// is adjusted, points and keyframes leave it.
  /// @source Engel et al., DSO, arXiv:1607.02565, section 3; order of steps as published
  /// @return what a keyframe changed; null for other frames
  /// @throws std::logic_error before seed()
  std::unique_ptr<MapUpdate> map(const MappingJob& job);
  /// Gives up the window. @return its keyframes, oldest first
  std::vector<KeyframeSnapshot> clear();

 private:
  MapUpdate adjust(const SE3& T_cam_previous);
  [[nodiscard]] TrackingTarget targetOf(const SE3& T_cam_previous) const;
  void noteCamera(const window::CameraVector& sigmas);
  void scoreCamera();
  [[nodiscard]] SE3 poseOf(const TrackedPose& pose) const;
  [[nodiscard]] std::vector<KeyframeSnapshot> snapshots() const;
  [[nodiscard]] KeyframeSnapshot snapshot(const window::Keyframe& keyframe) const;

  PinholeCamera camera_;
  OdometryOptions options_;
  PixelSelector selector_;
  StuckRegions stuck_;
  window::WindowOptimizer optimizer_;
  track::TrackingReferenceBuilder reference_builder_;
  std::optional<window::Window> window_;
  int segment_ = 0;
  // Estimated by the last adjustment.
  std::optional<Readout> readout_;
  std::optional<std::array<double, 4>> camera_sigmas_;
  std::optional<RadialDistortion> radial_;
  std::optional<CameraScore> camera_score_;  // the most contradicting one of the segment
  int scored_ = -1;                          // keyframe after which the camera was scored last
  InnovationScale innovations_;              // of the readout
  double noise_ = 0;  // standard deviation of a pixel's residual, last adjustment [grey levels]
};

struct MappingResult {
  double seconds = 0;
  std::unique_ptr<MapUpdate> update;  ///< of a keyframe, else null
};

/// A mapper behind a queue: pipelined, it works in a thread of its own, else within submit(). One
/// thread at a time may call it.
class AsyncMapper {
 public:
  /// @param arena of the calling thread; used where the mapper has no thread of its own
  AsyncMapper(const PinholeCamera& camera, const OdometryOptions& options, TaskArena& arena);

  /// Starts a new map, at once. The queue must be empty: clear() makes it so.
  [[nodiscard]] MappingResult seed(const InitializationResult& result, int segment);
  /// Puts a frame into the queue; waits while that is full.
  void submit(MappingJob job);
  /// @return the oldest result not yet taken; empty: there is none at the moment
  /// @throws what the mapper threw
  [[nodiscard]] std::optional<MappingResult> take();
  /// Whether there is work or a result to come.
  [[nodiscard]] bool busy() const { return queue_.busy(); }
  /// Whether a frame was submitted as a keyframe whose result is not yet taken.
  [[nodiscard]] bool keyframeIsDue() const { return keyframe_is_due_; }
  /// Waits until all submitted frames are mapped.
  void wait() { queue_.wait(); }
  /// Gives up queue and map. @return the map's keyframes, oldest first
  std::vector<KeyframeSnapshot> clear();

 private:
  template <typename Work>
  MappingResult run(const Work& work);

  TaskArena own_arena_;  // two threads in one arena of one thread would wait for each other
  TaskArena& arena_;
  Mapper mapper_;  // belongs to the queue while that is busy
  bool keyframe_is_due_ = false;
  WorkerQueue<MappingJob, MappingResult> queue_;  // last: its thread ends first
};

}  // namespace dsorb::odometry
