// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/pyramid.h"

#include <cmath>

namespace dsorb {

/// Whether bilinear interpolation at (x, y) reads only pixels at least `border` inside the level.
inline bool insideForInterpolation(const PyramidLevel& level, float x, float y, float border = 0) {
  return x >= border && y >= border && x < static_cast<float>(level.width() - 1) - border &&
         y < static_cast<float>(level.height() - 1) - border;
}

/// The four pixels around a position and where it lies between them.
struct InterpolationCell {
  const ImageSample* top;     ///< left of the upper two
  const ImageSample* bottom;  ///< left of the lower two
  float fx, fy;               ///< from the upper left pixel, [0, 1)
};

/// @param x, y position [px]; the caller guarantees insideForInterpolation
inline InterpolationCell cellAt(const PyramidLevel& level, float x, float y) {
  const int ix = static_cast<int>(x);
  const int iy = static_cast<int>(y);
  const ImageSample* top = level.row(iy) + ix;
  return {top, top + level.width(), x - static_cast<float>(ix), y - static_cast<float>(iy)};
}

/// Bilinear interpolation of intensity and stored central-difference gradients.
/// @param x, y position [px]; the caller guarantees insideForInterpolation
/// @return NaN intensity where one of the four pixels is invalid
inline ImageSample interpolate(const PyramidLevel& level, float x, float y) {
  const auto [top, bottom, fx, fy] = cellAt(level, x, y);
  const float w11 = fx * fy;
  const float w10 = fy - w11;
  const float w01 = fx - w11;
  const float w00 = 1.0F - fx - fy + w11;
  return {w00 * top[0].intensity + w01 * top[1].intensity + w10 * bottom[0].intensity +
              w11 * bottom[1].intensity,
          w00 * top[0].dx + w01 * top[1].dx + w10 * bottom[0].dx + w11 * bottom[1].dx,
          w00 * top[0].dy + w01 * top[1].dy + w10 * bottom[0].dy + w11 * bottom[1].dy};
}

/// Bilinear intensity with the exact gradient of that interpolation: difference of the interpolated
/// right and left (bottom and top) cell edges.
inline ImageSample interpolateWithCellGradient(const PyramidLevel& level, float x, float y) {
  const auto [top, bottom, fx, fy] = cellAt(level, x, y);
  const float left = (1.0F - fy) * top[0].intensity + fy * bottom[0].intensity;
  const float right = (1.0F - fy) * top[1].intensity + fy * bottom[1].intensity;
  const float above = (1.0F - fx) * top[0].intensity + fx * top[1].intensity;
  const float below = (1.0F - fx) * bottom[0].intensity + fx * bottom[1].intensity;
  return {(1.0F - fx) * left + fx * right, right - left, below - above};
}

/// Bilinear intensity alone.
inline float interpolateIntensity(const PyramidLevel& level, float x, float y) {
  const auto [top, bottom, fx, fy] = cellAt(level, x, y);
  return (1.0F - fy) * ((1.0F - fx) * top[0].intensity + fx * top[1].intensity) +
         fy * ((1.0F - fx) * bottom[0].intensity + fx * bottom[1].intensity);
}

}  // namespace dsorb
