// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/pyramid.h"

#include "base/lanes.h"

#include <Eigen/Core>

#include <array>
#include <cstddef>
#include <vector>

namespace dsorb {

/// Forward and backward again may miss the start by it [px].
constexpr float kMaxBackwardError = 1;

constexpr int kFlowWindow = 21;  ///< side of the aligned patch [px]
constexpr int kFlowColumns = (kFlowWindow + kLanes - 1) / kLanes * kLanes;  ///< in whole lanes

struct LucasKanadeOptions {
  int max_level = 4;            ///< coarsest level of the pyramid
  double min_eigenvalue = 0.3;  ///< of the mean gradient tensor [grey levels^2 / px^2]
};

/// One level of a FlowPyramid with a border around it.
struct FlowLevel {
  int width = 0;
  int height = 0;
  std::ptrdiff_t stride = 0;
  std::vector<float> memory;
  std::ptrdiff_t origin = 0;  ///< of the first pixel inside, in `memory`

  [[nodiscard]] const float* row(int y) const { return memory.data() + origin + y * stride; }
  [[nodiscard]] float* row(int y) { return memory.data() + origin + y * stride; }
};

/// Intensities alone, each level smoothed and halved from the one before (pixel x lies on pixel
/// 2 x), with a mirrored border so that windows may leave the image.
class FlowPyramid {
 public:
  /// Replaces what was there; memory is kept. Runs in parallel inside the caller's arena.
  /// @param gain applied to the intensities, which then stay within 0 .. 255; invalid pixels are 0
  /// @return     whether all pixels are valid
  bool build(const PyramidLevel& image, float gain, const LucasKanadeOptions& options);

  [[nodiscard]] const std::vector<FlowLevel>& levels() const { return levels_; }

 private:
  std::vector<FlowLevel> levels_;
};

/// Follows single points from one image to the next; one object a thread.
/// @source Bouguet, Pyramidal Implementation of the Lucas Kanade Feature Tracker; gradients by
///         Scharr's operator
class LucasKanade {
 public:
  explicit LucasKanade(const LucasKanadeOptions& options) : options_(options) {}

  /// @param from, to pyramids of the same size
  /// @param place    in `from` [px]; gets the place in `to`
  /// @return         false where the patch has no texture or leaves the image
  bool follow(const FlowPyramid& from, const FlowPyramid& to, Eigen::Vector2f& place) {
    return follow(from, to, Eigen::Vector2f(place), place);
  }
  /// @param start in `from` [px]
  /// @param place in `to`, where the search begins [px]; gets the place
  bool follow(const FlowPyramid& from,
              const FlowPyramid& to,
              const Eigen::Vector2f& start,
              Eigen::Vector2f& place);

 private:
  LucasKanadeOptions options_;
  // Interpolated, one pixel more on every side; gradients read beyond the last row.
  std::array<float, std::size_t{kFlowColumns + kLanes} * (kFlowWindow + 2) + kLanes> patch_{};
  // Intensity, dx, dy, row by row in each column of lanes.
  std::array<float, std::size_t{3} * kFlowColumns * kFlowWindow> template_{};
};

}  // namespace dsorb
