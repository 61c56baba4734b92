// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "estimate/host_patch.h"
#include "window/window.h"

#include <Eigen/Core>

#include <cstddef>
#include <vector>

namespace dsorb::window {

using Matrix8d = Eigen::Matrix<double, kFrameDim, kFrameDim>;
using Matrix8f = Eigen::Matrix<float, kFrameDim, kFrameDim>;
using Vector8f = Eigen::Matrix<float, kFrameDim, 1>;

/// Relative quantities of an ordered pair of keyframes.
struct PairGeometry {
  TargetImage current;            ///< into level 0 of the target
  Warp<float> first;              ///< poses at their first estimates, intrinsics current
  float host_offset_first = 0;    ///< b of the host at its first estimate [grey levels]
  RollingShutter host_shutter{};  ///< set only where `current` is rolling

  /// Relative gradients (translation, rotation, a, b) to scaled gradients of the host state.
  Matrix8d to_host;
  Matrix8f to_host_single;
  /// The same for the target; diagonal.
  Vector8d to_target;
  Vector8f to_target_single;
};

/// All ordered pairs of a window, row = host. Two refresh functions because first estimates are
/// constant during an adjustment.
class PairTable {
 public:
  /// Takes everything from the window.
  explicit PairTable(const Window& window);
  /// Takes the current poses, brightness and intrinsics from the window of unchanged size.
  void refreshCurrent(const Window& window);

  [[nodiscard]] const PairGeometry& at(std::size_t host, std::size_t target) const {
    return pairs_[host * size_ + target];
  }
  [[nodiscard]] std::size_t size() const { return size_; }
  [[nodiscard]] const HostRays& rays() const { return rays_; }

 private:
  std::size_t size_;
  HostRays rays_;
  std::vector<PairGeometry> pairs_;
};

}  // namespace dsorb::window
