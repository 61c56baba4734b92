// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/frame.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
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

/// The scales at which each pixel of level 0 passes the threshold of its region: the pixel itself,
/// and the pixels of levels 1 and 2 that cover it, with lower thresholds. Memory is reused between
/// frames of one size.
/// @source Engel et al., DSO, arXiv:1607.02565, section 3.2; factors of DSO as published
class ScaleMap {
 public:
  /// Takes the memory for frames of one size; compute() does so where it has not been done.
  void resize(int width, int height);
  /// @param threshold_factor on squared gradients
  void compute(const Frame& frame, const RegionThresholds& thresholds, float threshold_factor);

  /// @return for each pixel of the row the sum of its scales: 1, 2 and 4 pixels
  [[nodiscard]] const std::uint8_t* row(int y) const {
    return scales_.data() + static_cast<std::ptrdiff_t>(y) * width_;
  }

 private:
  int width_ = 0;
  std::vector<std::uint8_t> scales_;
};

/// A pixel worth a depth. `type` is the scale it qualified at: 1, 2 or 4 pixels.
struct SelectedPixel {
  int x = 0;
  int y = 0;
  int type = 1;
};

/// Whether no pixel of the residual pattern around (x, y) is outside the level or invalid.
[[nodiscard]] bool patternIsValid(const PyramidLevel& level, int x, int y);

struct PixelSelectorOptions {
  int first_block_size = 3;  ///< [px]
  int max_repetitions = 3;   ///< with another block size when the count is far off
  int seed = 1;              ///< of directions and thinning
};

/// Well-spread gradient pixels: in each block the strongest along a random direction, on three
/// scales, the block size adapted to the wanted number. Keeps the block size between frames.
/// @source Engel et al., DSO, section 3.2; random direction and control of the density: DSO as
///         published
class PixelSelector {
 public:
  PixelSelector(int width, int height, const PixelSelectorOptions& options);

  /// @param wanted           number of pixels; fewer come back where gradients are missing
  /// @param threshold_factor on squared gradients; DSO: 1 for keyframes, 2 for initialization
  /// @return in raster order of the blocks
  /// @throws std::invalid_argument when the frame has another size than the selector
  std::vector<SelectedPixel> select(const Frame& frame, int wanted, float threshold_factor = 1);

  /// Forgets the block size of earlier frames.
  void reset() { block_size_ = options_.first_block_size; }
  [[nodiscard]] int blockSize() const { return block_size_; }
  [[nodiscard]] const RegionThresholds& thresholds() const { return thresholds_; }

 private:
  PixelSelectorOptions options_;
  int width_;
  int height_;
  int block_size_;
  std::vector<std::uint8_t> random_bytes_;
  RegionThresholds thresholds_;
  ScaleMap scales_;
};

struct GridSelection {
  std::vector<SelectedPixel> pixels;
  int spacing = 5;  ///< the grid's, a good start for the next level or frame [px]
};

/// Up to four pixels of each grid cell: largest gradient along x, y and both diagonals. The spacing
/// is adapted to the wanted number.
/// @param spacing first spacing to try [px]
/// @source DSO as published, coarse levels of the initializer
[[nodiscard]] GridSelection selectGridMaxima(const PyramidLevel& level, int wanted, int spacing);

/// The pixel with the largest gradient of every square patch, where it passes its region's
/// threshold and its residual pattern is valid.
/// @param patch_size side of the patches [px]
/// @source [Gladkova], section 3.3
[[nodiscard]] std::vector<SelectedPixel> selectPatchMaxima(const Frame& frame,
                                                           const RegionThresholds& thresholds,
                                                           int patch_size);

}  // namespace dsorb
