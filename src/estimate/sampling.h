// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/pyramid.h"

#include "base/lanes.h"
#include "image/photometric.h"

#include <cstddef>
#include <cstring>

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

/// The three values of a sample in one register; the fourth float belongs to its right neighbour,
/// which must be there to be read.
using SampleQuad = float __attribute__((vector_size(16)));

DSORB_ALWAYS_INLINE void loadQuad(const ImageSample* sample, SampleQuad& quad) {
  std::memcpy(&quad, &sample->intensity, sizeof(SampleQuad));
}

/// Bilinear interpolation of all values of a sample at once; 3 x 2 pixels are read.
/// @param samples first of the image, `width` a row
/// @param x, y    position [px], inside the image by one pixel more on the right
DSORB_ALWAYS_INLINE void interpolateQuad(
    const ImageSample* samples, std::ptrdiff_t width, float x, float y, SampleQuad& value) {
  const int ix = static_cast<int>(x);
  const int iy = static_cast<int>(y);
  const float fx = x - static_cast<float>(ix);
  const float fy = y - static_cast<float>(iy);
  const ImageSample* top = samples + iy * width + ix;
  const ImageSample* bottom = top + width;
  SampleQuad q00;
  SampleQuad q01;
  SampleQuad q10;
  SampleQuad q11;
  loadQuad(top, q00);
  loadQuad(top + 1, q01);
  loadQuad(bottom, q10);
  loadQuad(bottom + 1, q11);
  const SampleQuad upper = q00 + fx * (q01 - q00);
  const SampleQuad lower = q10 + fx * (q11 - q10);
  value = upper + fy * (lower - upper);
}

/// Offsets of kPattern, a lane a pixel [px].
static_assert(kPatternSize == kLanes, "one lane a pixel of the pattern");
constexpr Lanes kPatternX = {kPattern[0].x,
                             kPattern[1].x,
                             kPattern[2].x,
                             kPattern[3].x,
                             kPattern[4].x,
                             kPattern[5].x,
                             kPattern[6].x,
                             kPattern[7].x};
constexpr Lanes kPatternY = {kPattern[0].y,
                             kPattern[1].y,
                             kPattern[2].y,
                             kPattern[3].y,
                             kPattern[4].y,
                             kPattern[5].y,
                             kPattern[6].y,
                             kPattern[7].y};

/// Values and gradients at eight positions.
struct LaneSamples {
  Lanes intensity;
  Lanes dx;
  Lanes dy;
};

/// Bilinear samples, all eight at once; a quad holds one sample and one value of the next, unused.
/// @param x, y positions as for interpolateQuad()
DSORB_ALWAYS_INLINE void interpolateLanes(const ImageSample* image,
                                          std::ptrdiff_t width,
                                          const Lanes& x,
                                          const Lanes& y,
                                          LaneSamples& samples) {
  SampleQuad values[kLanes];
  for (int k = 0; k < kLanes; ++k) interpolateQuad(image, width, x[k], y[k], values[k]);
  SampleQuad intensity[2];
  SampleQuad dx[2];
  SampleQuad dy[2];
  for (int half = 0; half < 2; ++half) {
    const SampleQuad* v = values + std::ptrdiff_t{4} * half;
    const SampleQuad front01 = __builtin_shufflevector(v[0], v[1], 0, 4, 1, 5);
    const SampleQuad front23 = __builtin_shufflevector(v[2], v[3], 0, 4, 1, 5);
    const SampleQuad back01 = __builtin_shufflevector(v[0], v[1], 2, 6, 3, 7);
    const SampleQuad back23 = __builtin_shufflevector(v[2], v[3], 2, 6, 3, 7);
    intensity[half] = __builtin_shufflevector(front01, front23, 0, 1, 4, 5);
    dx[half] = __builtin_shufflevector(front01, front23, 2, 3, 6, 7);
    dy[half] = __builtin_shufflevector(back01, back23, 0, 1, 4, 5);
  }
  samples.intensity = __builtin_shufflevector(intensity[0], intensity[1], 0, 1, 2, 3, 4, 5, 6, 7);
  samples.dx = __builtin_shufflevector(dx[0], dx[1], 0, 1, 2, 3, 4, 5, 6, 7);
  samples.dy = __builtin_shufflevector(dy[0], dy[1], 0, 1, 2, 3, 4, 5, 6, 7);
}

}  // namespace dsorb
