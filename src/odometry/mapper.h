// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/init/result.h"
#include "dsorb/odometry/observer.h"
#include "dsorb/options/odometry.h"

#include "image/photometric.h"
#include "image/pixel_selector.h"
#include "window/point_activation.h"
#include "window/window.h"
#include "window/window_optimizer.h"

#include <cstddef>
#include <optional>
#include <vector>

namespace dsorb::odometry {

/// What a new keyframe did to the map.
struct MappingReport {
  window::OptimizationReport adjustment;
  int keyframes_so_far = 0;  ///< since the initialization, this one included
  /// What the next frames are tracked against: inverse depths in the newest keyframe.
  std::vector<DepthSample> reference;
  std::vector<window::Keyframe> retired;  ///< left the window, oldest first
};

/// Owner of the window: takes over an initialization, refines candidates with tracked frames, adds
/// keyframes. Knows neither the tracker nor observers.
class Mapper {
 public:
  Mapper(const PinholeCamera& camera, const OdometryOptions& options);

  /// Starts a new window from an initialization and adjusts it.
  MappingReport seed(const InitializationResult& result);
  /// Searches all candidates in a tracked frame.
  void refine(const window::TrackedFrame& tracked);
  /// The frame, already used by refine(), becomes a keyframe; the window is adjusted, points and
  /// keyframes leave it.
  /// @source Engel et al., DSO, arXiv:1607.02565, section 3; order of steps as published
  MappingReport addKeyframe(const window::TrackedFrame& tracked);
  /// Gives up the window. @return its keyframes, oldest first
  std::vector<window::Keyframe> clear();

  [[nodiscard]] bool empty() const { return !window_; }
  // The following need a window.
  [[nodiscard]] const window::Keyframe& newest() const { return window_->keyframes.back(); }
  [[nodiscard]] const std::vector<window::Keyframe>& keyframes() const {
    return window_->keyframes;
  }
  [[nodiscard]] PinholeCamera camera() const { return window_->camera(); }

 private:
  MappingReport adjust();

  PinholeCamera camera_;
  OdometryOptions options_;
  PixelSelector selector_;
  window::WindowOptimizer optimizer_;
  std::optional<window::Window> window_;
};

/// A keyframe of the window as observers see it: its points, those of the adjustment and those
/// that left it with their information kept.
/// @param noise standard deviation of a pixel's residual [grey levels], turns information into
///              variance
[[nodiscard]] KeyframeSnapshot snapshot(const window::Keyframe& keyframe,
                                        const PinholeCamera& camera,
                                        int segment,
                                        double noise);

}  // namespace dsorb::odometry
