// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/calibration.h"
#include "dsorb/odometry/observer.h"

#include "io/output/json_text.h"

#include <array>
#include <optional>
#include <set>
#include <string>
#include <vector>

namespace dsorb::io {

/// Calibration file of images as they were taken, as DSO's camera.txt.
/// @param lens a pinhole or kRadTan
[[nodiscard]] std::string calibrationFile(const Lens& lens);

/// The camera that the window refines, over a run: the estimate of the segment that knows the focal
/// length best.
class CameraEstimate {
 public:
  /// Takes the camera of the newest keyframe, a few doubles of it.
  void add(const KeyframeSnapshot& keyframe);

  [[nodiscard]] const std::optional<PinholeCamera>& camera() const { return known_.camera; }
  /// Whether the focal length is known to 1 %: by two sigmas, and by how much it still moved.
  [[nodiscard]] bool isSettled() const;
  /// The object in run.json: the camera and, where the window estimates it, how sure that is.
  /// @param with_sigma of a camera that is not null
  [[nodiscard]] Json json() const;

  /// Calibration file of the images as they were taken, as DSO's camera.txt.
  /// @param lens      that was taken for that of the images, without distortion
  /// @param rectified the camera that the odometry began with
  /// @return empty where the estimate is not known or the lens had a distortion
  [[nodiscard]] std::string calibrationFile(const Lens& lens, const PinholeCamera& rectified) const;

 private:
  struct Estimate {
    std::optional<PinholeCamera> camera;
    std::optional<std::array<double, 4>> sigmas;  // fx, fy, cx, cy [px]
    std::optional<RadialDistortion> radial;
    double moved = 0;  // in the last third of its segment, relative
    int segment = -1;
  };
  [[nodiscard]] bool isDistorted() const;
  [[nodiscard]] static double focalSigma(const Estimate& estimate);
  [[nodiscard]] double movement() const;

  Estimate newest_;
  Estimate known_;
  int segment_ = -1;
  std::set<FrameId> frames_;           // keyframes of the segment
  std::vector<double> focal_lengths_;  // one a keyframe
};

}  // namespace dsorb::io
