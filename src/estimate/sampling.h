// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/pyramid.h"

#include "base/lanes.h"
#include "base/shuffle.h"

#include <cmath>
#include <cstddef>
#include <cstring>

/// Bilinear interpolation of an image: one arithmetic, one border rule, for one position or eight.
namespace dsorb {

/// The border rule: coordinates are in [kNearBorder, size - kFarBorder). There all pixels that are
/// read have central differences, which the outermost ones lack, and a load of four floats, which
/// takes in a value of the next pixel on the right, stays in the row.
constexpr float kNearBorder = 1;  ///< [px]
constexpr float kFarBorder = 2;   ///< [px]

/// The greatest coordinate within the border rule.
inline float lastSample(int size) {
  return std::nextafter(static_cast<float>(size) - kFarBorder, 0.0F);
}

/// Whether everything within `margin` of a position can be interpolated; false for NaN.
inline bool canSample(const PyramidLevel& level, float x, float y, float margin = 0) {
  const float near = kNearBorder + margin;
  const float far = kFarBorder + margin;
  return x >= near && y >= near && x < static_cast<float>(level.width()) - far &&
         y < static_cast<float>(level.height()) - far;
}

/// Between four neighbours. @tparam T a number or several in a register
template <typename T, typename Scalar>
DSORB_ALWAYS_INLINE T bilinear(const T (&top)[2], const T (&bottom)[2], Scalar fx, Scalar fy) {
  const T upper = top[0] + fx * (top[1] - top[0]);
  const T lower = bottom[0] + fx * (bottom[1] - bottom[0]);
  return upper + fy * (lower - upper);
}

/// The four pixels around a position and where it lies between them.
template <typename Scalar>
struct InterpolationCell {
  const ImageSample* top;     ///< left of the upper two
  const ImageSample* bottom;  ///< left of the lower two
  Scalar fx, fy;              ///< from the upper left pixel, [0, 1)

  InterpolationCell(const ImageSample* image, std::ptrdiff_t width, Scalar x, Scalar y) {
    const int ix = static_cast<int>(x);
    const int iy = static_cast<int>(y);
    top = image + iy * width + ix;
    bottom = top + width;
    fx = x - static_cast<Scalar>(ix);
    fy = y - static_cast<Scalar>(iy);
  }

  [[nodiscard]] Scalar at(float ImageSample::*value) const {
    const Scalar upper[2] = {static_cast<Scalar>(top[0].*value),
                             static_cast<Scalar>(top[1].*value)};
    const Scalar lower[2] = {static_cast<Scalar>(bottom[0].*value),
                             static_cast<Scalar>(bottom[1].*value)};
    return bilinear(upper, lower, fx, fy);
  }
};

/// Intensity with gradients; NaN intensity where one of the four pixels is invalid.
template <typename Scalar>
struct Sample {
  Scalar intensity;  ///< [grey levels]
  Scalar dx, dy;     ///< [grey levels / px]
};

/// Intensity and central differences, all interpolated.
/// @param x, y position [px]; the caller guarantees canSample()
template <typename Scalar>
inline Sample<Scalar> interpolate(const PyramidLevel& level, Scalar x, Scalar y) {
  const InterpolationCell<Scalar> cell(level.data(), level.width(), x, y);
  return {cell.at(&ImageSample::intensity), cell.at(&ImageSample::dx), cell.at(&ImageSample::dy)};
}

/// Intensity alone.
inline float interpolateIntensity(const PyramidLevel& level, float x, float y) {
  return InterpolationCell<float>(level.data(), level.width(), x, y).at(&ImageSample::intensity);
}

/// Intensity with the exact gradient of its interpolation: the difference of the interpolated right
/// and left (bottom and top) edges of the cell.
inline Sample<float> interpolateWithCellGradient(const PyramidLevel& level, float x, float y) {
  const InterpolationCell<float> cell(level.data(), level.width(), x, y);
  const auto [top, bottom, fx, fy] = cell;
  const float above = top[1].intensity - top[0].intensity;
  const float below = bottom[1].intensity - bottom[0].intensity;
  const float left = bottom[0].intensity - top[0].intensity;
  const float right = bottom[1].intensity - top[1].intensity;
  return {
      cell.at(&ImageSample::intensity), above + fy * (below - above), left + fx * (right - left)};
}

/// The three values of a sample in one register; the fourth float belongs to its right neighbour.
using SampleQuad = float __attribute__((vector_size(16)));

/// All values of a sample at once.
/// @param image first sample of the level, `width` a row
DSORB_ALWAYS_INLINE void interpolateQuad(
    const ImageSample* image, std::ptrdiff_t width, float x, float y, SampleQuad& value) {
  const InterpolationCell<float> cell(image, width, x, y);
  SampleQuad top[2];
  SampleQuad bottom[2];
  for (int i = 0; i < 2; ++i) {
    std::memcpy(&top[i], &cell.top[i].intensity, sizeof(SampleQuad));
    std::memcpy(&bottom[i], &cell.bottom[i].intensity, sizeof(SampleQuad));
  }
  value = bilinear(top, bottom, cell.fx, cell.fy);
}

/// Intensities alone at eight positions; the caller guarantees canSample().
DSORB_ALWAYS_INLINE void interpolateIntensities(const ImageSample* image,
                                                std::ptrdiff_t width,
                                                const Lanes& x,
                                                const Lanes& y,
                                                Lanes& intensity) {
  SampleQuad edge[kLanes];  // first: intensity on the left edge of the cell, last: on its right
  Lanes fx;
  for (int k = 0; k < kLanes; ++k) {
    const InterpolationCell<float> cell(image, width, x[k], y[k]);
    SampleQuad top;
    SampleQuad bottom;
    std::memcpy(&top, &cell.top->intensity, sizeof(SampleQuad));
    std::memcpy(&bottom, &cell.bottom->intensity, sizeof(SampleQuad));
    edge[k] = top + cell.fy * (bottom - top);
    fx[k] = cell.fx;
  }
  SampleQuad left[2];
  SampleQuad right[2];
  for (int half = 0; half < 2; ++half) {
    const SampleQuad* v = edge + std::ptrdiff_t{4} * half;
    const SampleQuad pair01 = DSORB_SHUFFLE(v[0], v[1], 0, 4, 3, 7);
    const SampleQuad pair23 = DSORB_SHUFFLE(v[2], v[3], 0, 4, 3, 7);
    left[half] = DSORB_SHUFFLE(pair01, pair23, 0, 1, 4, 5);
    right[half] = DSORB_SHUFFLE(pair01, pair23, 2, 3, 6, 7);
  }
  const Lanes lefts = DSORB_SHUFFLE(left[0], left[1], 0, 1, 2, 3, 4, 5, 6, 7);
  const Lanes rights = DSORB_SHUFFLE(right[0], right[1], 0, 1, 2, 3, 4, 5, 6, 7);
  intensity = lefts + fx * (rights - lefts);
}

/// Values and gradients at eight positions.
struct LaneSamples {
  Lanes intensity;
  Lanes dx;
  Lanes dy;
};

/// Eight positions at once.
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
    const SampleQuad front01 = DSORB_SHUFFLE(v[0], v[1], 0, 4, 1, 5);
    const SampleQuad front23 = DSORB_SHUFFLE(v[2], v[3], 0, 4, 1, 5);
    const SampleQuad back01 = DSORB_SHUFFLE(v[0], v[1], 2, 6, 3, 7);
    const SampleQuad back23 = DSORB_SHUFFLE(v[2], v[3], 2, 6, 3, 7);
    intensity[half] = DSORB_SHUFFLE(front01, front23, 0, 1, 4, 5);
    dx[half] = DSORB_SHUFFLE(front01, front23, 2, 3, 6, 7);
    dy[half] = DSORB_SHUFFLE(back01, back23, 0, 1, 4, 5);
  }
  samples.intensity = DSORB_SHUFFLE(intensity[0], intensity[1], 0, 1, 2, 3, 4, 5, 6, 7);
  samples.dx = DSORB_SHUFFLE(dx[0], dx[1], 0, 1, 2, 3, 4, 5, 6, 7);
  samples.dy = DSORB_SHUFFLE(dy[0], dy[1], 0, 1, 2, 3, 4, 5, 6, 7);
}

}  // namespace dsorb
