// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/image_view.h"

#include <cmath>
#include <cstddef>
#include <memory>
#include <vector>

namespace dsorb {

/// Intensity [grey levels, nominally 0..255] and its gradient [grey levels / px of the level].
struct ImageSample {
  float intensity;  ///< [grey levels]; NaN: invalid
  float dx;         ///< slope to the right [grey levels / px]
  float dy;         ///< downwards [grey levels / px]
};

/// One level of the pyramid: contiguous row-major intensities [grey levels], NaN where invalid.
/// Gradients are made where they are needed: images three times as large would have to be read.
class PyramidLevel {
 public:
  /// @param data width times height intensities, not owned
  PyramidLevel(const float* data, int width, int height)
      : data_(data), width_(width), height_(height) {}

  /// Width [px].
  [[nodiscard]] int width() const { return width_; }
  /// Height [px].
  [[nodiscard]] int height() const { return height_; }
  /// First intensity of the first row; rows follow each other.
  [[nodiscard]] const float* data() const { return data_; }
  /// First intensity of a row.
  [[nodiscard]] const float* row(int y) const {
    return data_ + static_cast<std::ptrdiff_t>(y) * width_;
  }
  /// Intensity; unchecked.
  [[nodiscard]] float intensity(int x, int y) const { return row(y)[x]; }
  /// Intensity with central differences, which are 0 on the outermost rows and columns, at an
  /// invalid pixel and beside one; unchecked.
  [[nodiscard]] ImageSample at(int x, int y) const;

 private:
  const float* data_;
  int width_;
  int height_;
};

inline ImageSample PyramidLevel::at(int x, int y) const {
  const float* pixel = row(y) + x;
  const bool outermost = x == 0 || y == 0 || x == width_ - 1 || y == height_ - 1;
  if (outermost || std::isnan(*pixel)) return {*pixel, 0, 0};
  const float dx = 0.5F * (pixel[1] - pixel[-1]);
  const float dy = 0.5F * (pixel[width_] - pixel[-width_]);
  return {*pixel, std::isnan(dx) ? 0 : dx, std::isnan(dy) ? 0 : dy};
}

/// Number of pyramid levels for a size: it is halved while both sides are even, the level has more
/// than 5000 pixels and there are fewer than 5 levels.
/// @source front end of DSO as published, with the level limit mended from 6 to 5
[[nodiscard]] int pyramidLevels(int width, int height);

/// Image pyramid, immutable after construction. Level 0 is the full image, each further level the
/// mean of 2 x 2 pixels, invalid where one of them is.
class Pyramid {
 public:
  /// @param image 8-bit or float (what is not finite is invalid), width and height at least 16
  /// @throws std::invalid_argument on an empty or too small image
  explicit Pyramid(const ImageView& image);

  /// Number of levels, 1 to 5.
  [[nodiscard]] int levels() const { return static_cast<int>(levels_.size()); }
  /// @param index 0: full size; unchecked
  [[nodiscard]] const PyramidLevel& level(int index) const {
    return levels_[static_cast<std::size_t>(index)];
  }
  /// Width of level 0 [px].
  [[nodiscard]] int width() const { return levels_.front().width(); }
  /// Height of level 0 [px].
  [[nodiscard]] int height() const { return levels_.front().height(); }

 private:
  std::unique_ptr<float[]> intensities_;
  std::vector<PyramidLevel> levels_;
};

}  // namespace dsorb
