// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/calibration.h"
#include "dsorb/odometry/observer.h"

#include <array>
#include <optional>
#include <set>
#include <vector>

namespace dsorb {

/// The camera that the window refines, over a run: the estimate of the segment that knows the focal
/// length best.
class RefinedCamera {
 public:
  struct Estimate {
    std::optional<PinholeCamera> camera;          ///< empty before the first keyframe
    std::optional<std::array<double, 4>> sigmas;  ///< fx, fy, cx, cy [px]
    std::optional<RadialDistortion> radial;
    double moved = 0;  ///< in the last third of its segment, relative
    int segment = -1;
  };

  /// Takes the camera of the newest keyframe, a few doubles of it.
  void add(const KeyframeSnapshot& keyframe);

  [[nodiscard]] const Estimate& estimate() const { return known_; }
  /// Whether the focal length is known to 1 %: by two sigmas, and by how much it still moved.
  [[nodiscard]] bool isSettled() const;
  /// Lens of the images as they were taken.
  /// @param lens      that was taken for theirs, without distortion
  /// @param rectified the camera that the odometry began with
  /// @return empty where the estimate is not known or the lens had a distortion
  [[nodiscard]] std::optional<Lens> lens(const Lens& lens, const PinholeCamera& rectified) const;

 private:
  [[nodiscard]] static double focalSigma(const Estimate& estimate);
  [[nodiscard]] double movement() const;

  Estimate known_;
  int segment_ = -1;
  std::set<FrameId> frames_;           // keyframes of the segment
  std::vector<double> focal_lengths_;  // one a keyframe
};

}  // namespace dsorb
