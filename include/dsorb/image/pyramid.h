// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/image_view.h"

#include <memory>
#include <vector>

namespace dsorb {

/// Intensity [grey levels, nominally 0..255] and its gradient [grey levels / px of the level].
/// An invalid pixel has intensity NaN and gradient 0.
struct ImageSample {
  float intensity;  ///< [grey levels]
  float dx;         ///< to the right [grey levels / px]
  float dy;         ///< downwards [grey levels / px]
};

/// One level of the pyramid: contiguous row-major samples.
class PyramidLevel {
 public:
  /// @param data width times height samples, not owned
  PyramidLevel(const ImageSample* data, int width, int height)
      : data_(data), width_(width), height_(height) {}

  /// [px]
  [[nodiscard]] int width() const { return width_; }
  /// [px]
  [[nodiscard]] int height() const { return height_; }
  /// First sample of the first row; rows follow each other.
  [[nodiscard]] const ImageSample* data() const { return data_; }
  /// First sample of a row.
  [[nodiscard]] const ImageSample* row(int y) const {
    return data_ + static_cast<std::ptrdiff_t>(y) * width_;
  }
  /// Unchecked.
  [[nodiscard]] const ImageSample& at(int x, int y) const { return row(y)[x]; }

 private:
  const ImageSample* data_;
  int width_;
  int height_;
};

/// Number of pyramid levels for a size: it is halved while both sides are even, the level has more
/// than 5000 pixels and there are fewer than 5 levels.
/// @source front end of DSO as published, with the level limit mended from 6 to 5
[[nodiscard]] int pyramidLevels(int width, int height);

/// Image pyramid, immutable after construction. Level 0 is the full image, each further level the
/// mean of 2 x 2 pixels; gradients are central differences within the level, 0 on its outermost
/// rows and columns and beside invalid pixels.
class Pyramid {
 public:
  /// @param image 8-bit or float, width and height at least 16
  /// @throws std::invalid_argument on an empty or too small image
  explicit Pyramid(const ImageView& image);

  /// Number of levels, 1 to 5.
  [[nodiscard]] int levels() const { return static_cast<int>(levels_.size()); }
  /// @param index 0: full size; unchecked
  [[nodiscard]] const PyramidLevel& level(int index) const {
    return levels_[static_cast<std::size_t>(index)];
  }
  /// Of level 0 [px].
  [[nodiscard]] int width() const { return levels_.front().width(); }
  /// Of level 0 [px].
  [[nodiscard]] int height() const { return levels_.front().height(); }

 private:
  std::unique_ptr<ImageSample[]> samples_;
  std::vector<PyramidLevel> levels_;
};

}  // namespace dsorb
