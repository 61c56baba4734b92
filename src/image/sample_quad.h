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

}  // namespace dsorb
