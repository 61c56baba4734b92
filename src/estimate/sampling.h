// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/pyramid.h"

#include "base/lanes.h"
#include "base/shuffle.h"

#include <cmath>
#include <cstddef>
#include <cstring>
#include <limits>

/// Bilinear interpolation of an image: one arithmetic, one border rule, for one position or eight.
namespace dsorb {

/// The border rule: coordinates are in [kNearBorder, size - kFarBorder). There all pixels that are
/// read have central differences, which the outermost ones lack: the four around the position and
/// the eight beside them are in the image.
constexpr float kNearBorder = 1;  ///< [px]
constexpr float kFarBorder = 2;   ///< [px]

/// More than places on a line are rounded by, as sums of an origin, a stretch and an offset. A
/// search that ends at the border stays this far away [px].
constexpr float kLineRounding = 0.01F;

/// The greatest coordinate within the border rule.
inline float lastSample(int size) {
  return std::nextafter(static_cast<float>(size) - kFarBorder, 0.0F);
}

/// Whether everything within `margin` of a position can be interpolated; false for NaN. Rounded as
/// the sums of position and offset are.
inline bool canSample(const PyramidLevel& level, float x, float y, float margin = 0) {
  return x - margin >= kNearBorder && y - margin >= kNearBorder &&
         x + margin < static_cast<float>(level.width()) - kFarBorder &&
         y + margin < static_cast<float>(level.height()) - kFarBorder;
}

/// Between four neighbours. @tparam T a number or several in a register
template <typename T, typename Scalar>
DSORB_ALWAYS_INLINE T
bilinear(const T (&top)[2], const T (&bottom)[2], const Scalar& fx, const Scalar& fy) {
  const T upper = top[0] + fx * (top[1] - top[0]);
  const T lower = bottom[0] + fx * (bottom[1] - bottom[0]);
  return upper + fy * (lower - upper);
}

/// The four pixels around a position and where it lies between them.
template <typename Scalar>
struct InterpolationCell {
  const float* top;     ///< left of the upper two
  const float* bottom;  ///< left of the lower two
  Scalar fx, fy;        ///< from the upper left pixel, [0, 1)

  InterpolationCell(const float* image, std::ptrdiff_t width, Scalar x, Scalar y) {
    const int ix = static_cast<int>(x);
    const int iy = static_cast<int>(y);
    top = image + iy * width + ix;
    bottom = top + width;
    fx = x - static_cast<Scalar>(ix);
    fy = y - static_cast<Scalar>(iy);
  }

  /// @param value of a pixel, by its address
  template <typename Value>
  [[nodiscard]] Scalar at(const Value& value) const {
    const Scalar upper[2] = {static_cast<Scalar>(value(top)), static_cast<Scalar>(value(top + 1))};
    const Scalar lower[2] = {static_cast<Scalar>(value(bottom)),
                             static_cast<Scalar>(value(bottom + 1))};
    return bilinear(upper, lower, fx, fy);
  }

  [[nodiscard]] Scalar intensity() const {
    return at([](const float* pixel) { return *pixel; });
  }
};

/// Intensity with gradients; where one of the pixels that it is made of is invalid, the intensity
/// is NaN and the gradients are 0.
template <typename Scalar>
struct Sample {
  Scalar intensity;  ///< [grey levels]
  Scalar dx, dy;     ///< [grey levels / px]
};

/// Intensity and central differences, all interpolated.
/// @param x, y position [px]; the caller guarantees canSample()
template <typename Scalar>
inline Sample<Scalar> interpolate(const PyramidLevel& level, Scalar x, Scalar y) {
  const std::ptrdiff_t width = level.width();
  const InterpolationCell<Scalar> cell(level.data(), width, x, y);
  const Scalar dx = cell.at([](const float* pixel) { return 0.5F * (pixel[1] - pixel[-1]); });
  const Scalar dy =
      cell.at([width](const float* pixel) { return 0.5F * (pixel[width] - pixel[-width]); });
  if (std::isnan(dx + dy)) return {std::numeric_limits<Scalar>::quiet_NaN(), 0, 0};
  return {cell.intensity(), dx, dy};
}

/// Intensity alone.
inline float interpolateIntensity(const PyramidLevel& level, float x, float y) {
  return InterpolationCell<float>(level.data(), level.width(), x, y).intensity();
}

/// Intensity with the exact gradient of its interpolation: the difference of the interpolated right
/// and left (bottom and top) edges of the cell.
inline Sample<float> interpolateWithCellGradient(const PyramidLevel& level, float x, float y) {
  const InterpolationCell<float> cell(level.data(), level.width(), x, y);
  const auto [top, bottom, fx, fy] = cell;
  const float above = top[1] - top[0];
  const float below = bottom[1] - bottom[0];
  const float left = bottom[0] - top[0];
  const float right = bottom[1] - top[1];
  return {cell.intensity(), above + fy * (below - above), left + fx * (right - left)};
}

/// Four pixels of a row, from left of the position to two right of it.
using PixelQuad = float __attribute__((vector_size(16)));

DSORB_ALWAYS_INLINE PixelQuad loadAround(const float* pixel) {
  PixelQuad quad;
  std::memcpy(&quad, pixel - 1, sizeof(PixelQuad));
  return quad;
}

/// Columns `first` and `first + 1` of eight quads.
template <int first>
DSORB_ALWAYS_INLINE void twoColumns(const PixelQuad (&quads)[kLanes], Lanes (&columns)[2]) {
  PixelQuad left[2];
  PixelQuad right[2];
  for (int half = 0; half < 2; ++half) {
    const PixelQuad* q = quads + std::ptrdiff_t{4} * half;
    const PixelQuad pair01 = DSORB_SHUFFLE(q[0], q[1], first, first + 4, first + 1, first + 5);
    const PixelQuad pair23 = DSORB_SHUFFLE(q[2], q[3], first, first + 4, first + 1, first + 5);
    left[half] = DSORB_SHUFFLE(pair01, pair23, 0, 1, 4, 5);
    right[half] = DSORB_SHUFFLE(pair01, pair23, 2, 3, 6, 7);
  }
  columns[0] = DSORB_SHUFFLE(left[0], left[1], 0, 1, 2, 3, 4, 5, 6, 7);
  columns[1] = DSORB_SHUFFLE(right[0], right[1], 0, 1, 2, 3, 4, 5, 6, 7);
}

/// Intensities alone at eight positions; the caller guarantees canSample().
DSORB_ALWAYS_INLINE Lanes interpolateIntensities(const float* image,
                                                 std::ptrdiff_t width,
                                                 const Lanes& x,
                                                 const Lanes& y) {
  PixelQuad edges[kLanes];
  Lanes fx;
  for (int k = 0; k < kLanes; ++k) {
    const InterpolationCell<float> cell(image, width, x[k], y[k]);
    const PixelQuad top = loadAround(cell.top);
    edges[k] = top + cell.fy * (loadAround(cell.bottom) - top);
    fx[k] = cell.fx;
  }
  Lanes sides[2];
  twoColumns<1>(edges, sides);
  return sides[0] + fx * (sides[1] - sides[0]);
}

/// Samples at eight positions.
struct LaneSamples {
  Lanes intensity;
  Lanes dx;
  Lanes dy;
};

/// Eight positions at once.
DSORB_ALWAYS_INLINE LaneSamples interpolateLanes(const float* image,
                                                 std::ptrdiff_t width,
                                                 const Lanes& x,
                                                 const Lanes& y) {
  PixelQuad tops[kLanes];
  PixelQuad bottoms[kLanes];
  PixelQuad outsides[kLanes];  // the two above the cell, the two below it
  Lanes fx;
  Lanes fy;
  for (int k = 0; k < kLanes; ++k) {
    const InterpolationCell<float> cell(image, width, x[k], y[k]);
    tops[k] = loadAround(cell.top);
    bottoms[k] = loadAround(cell.bottom);
    const PixelQuad above = loadAround(cell.top - width);
    const PixelQuad below = loadAround(cell.bottom + width);
    outsides[k] = DSORB_SHUFFLE(above, below, 1, 2, 5, 6);
    fx[k] = cell.fx;
    fy[k] = cell.fy;
  }
  Lanes top[2][2];  // columns 0 to 3
  Lanes bottom[2][2];
  Lanes above[2];  // columns 1 and 2
  Lanes below[2];
  twoColumns<0>(tops, top[0]);
  twoColumns<2>(tops, top[1]);
  twoColumns<0>(bottoms, bottom[0]);
  twoColumns<2>(bottoms, bottom[1]);
  twoColumns<0>(outsides, above);
  twoColumns<2>(outsides, below);
  const Lanes upper[2] = {top[0][1], top[1][0]};
  const Lanes lower[2] = {bottom[0][1], bottom[1][0]};
  const Lanes upper_dx[2] = {top[1][0] - top[0][0], top[1][1] - top[0][1]};
  const Lanes lower_dx[2] = {bottom[1][0] - bottom[0][0], bottom[1][1] - bottom[0][1]};
  const Lanes upper_dy[2] = {lower[0] - above[0], lower[1] - above[1]};
  const Lanes lower_dy[2] = {below[0] - upper[0], below[1] - upper[1]};
  const Lanes dx = bilinear(upper_dx, lower_dx, fx, fy);
  const Lanes dy = bilinear(upper_dy, lower_dy, fx, fy);
  const Lanes gradients = dx + dy;
  const auto valid = gradients == gradients;  // no NaN
  const Lanes zero = {};
  return {valid ? bilinear(upper, lower, fx, fy) : gradients,
          valid ? 0.5F * dx : zero,
          valid ? 0.5F * dy : zero};
}

}  // namespace dsorb
