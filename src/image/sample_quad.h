// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/pyramid.h"

#include "base/lanes.h"

#include <cstddef>
#include <cstring>

namespace dsorb {

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
