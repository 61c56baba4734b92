// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/init/result.h"
#include "dsorb/odometry/observer.h"
#include "dsorb/options/odometry.h"

#include "image/pixel_selector.h"
#include "image/stuck_regions.h"
#include "odometry/frame_tracker.h"
#include "odometry/innovation_scale.h"
#include "window/window.h"
#include "window/window_optimizer.h"

#include <array>
#include <memory>
#include <optional>
#include <vector>

namespace dsorb::odometry {

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

}  // namespace dsorb::odometry
