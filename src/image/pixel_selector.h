// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/frame.h"

#include "image/region_thresholds.h"
#include "image/scale_map.h"

#include <cstdint>
#include <vector>

namespace dsorb {

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
