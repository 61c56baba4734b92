// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/frame.h"

#include <algorithm>
#include <cstddef>
#include <vector>

namespace dsorb {

/// Squared gradients of a row in raw camera values; 0 in the image's outermost pixels, at an
/// invalid one and beside it.
/// @param slope   of the response; null when it is linear
/// @param squared a value a pixel
void squareGradients(const PyramidLevel& level, int y, const ResponseSlope* slope, float* squared);

/// Squared gradients of level 0 in raw camera values (weighted by the slope of the response) and
/// the threshold a pixel has to pass in its 32x32 region: median gradient plus a constant, smoothed
/// over 3x3 regions, squared. Memory is reused between frames of one size.
/// @source Engel et al., DSO, arXiv:1607.02565, section 3.2; strips that fill no region belong to
///         the last one, invalid pixels do not vote
class RegionThresholds {
 public:
  /// Takes the memory for frames of one size; compute() does so where it has not been done.
  void resize(int width, int height);
  void compute(const Frame& frame);

  [[nodiscard]] const float* squaredGradients(int y) const {
    return squared_gradients_.data() + static_cast<std::ptrdiff_t>(y) * width_;
  }
  /// Thresholds of squared gradients of the row of regions that pixel row `y` belongs to.
  [[nodiscard]] const float* regionRow(int y) const {
    return squared_thresholds_.data() +
           static_cast<std::ptrdiff_t>(std::min(y / kRegionSize, regions_y_ - 1)) * regions_x_;
  }
  [[nodiscard]] int regionColumn(int x) const { return std::min(x / kRegionSize, regions_x_ - 1); }
  [[nodiscard]] float squaredThreshold(int x, int y) const { return regionRow(y)[regionColumn(x)]; }

  static constexpr int kRegionSize = 32;  // [px]; DSO, section 3.2

 private:
  void medianGradients(const PyramidLevel& level);
  [[nodiscard]] int medianGradient(const PyramidLevel& level, int region) const;
  void smoothAndSquare();
  /// @param x,y of a region
  [[nodiscard]] std::size_t index(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(regions_x_) +
           static_cast<std::size_t>(x);
  }

  int width_ = 0;
  int regions_x_ = 0;
  int regions_y_ = 0;
  std::vector<float> squared_gradients_;
  std::vector<float> thresholds_;
  std::vector<float> squared_thresholds_;
};

}  // namespace dsorb
