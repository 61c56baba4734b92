// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/pyramid.h"

#include "estimate/sampling.h"
#include "image/photometric.h"

#include <Eigen/Core>

namespace dsorb {

/// One lane a pixel of the pattern.
using PatternLanes = Eigen::Array<float, kPatternSize, 1>;

/// Offsets of kPattern, one lane a pixel [px].
inline PatternLanes patternX() {
  return PatternLanes::NullaryExpr([](Eigen::Index k) { return kPatternX[k]; });
}
inline PatternLanes patternY() {
  return PatternLanes::NullaryExpr([](Eigen::Index k) { return kPatternY[k]; });
}

struct PatternSamples {
  PatternLanes intensity;
  PatternLanes dx;
  PatternLanes dy;
};

/// Bilinear intensity and gradients at the 8 pixels of a pattern; same numbers as interpolate().
/// @param x, y positions [px], every one at least 1 px inside the low and 2 px inside the high edge
/// @note one 4-float load covers a sample and the next intensity, which is not used
inline PatternSamples samplePattern(const PyramidLevel& level,
                                    const PatternLanes& x,
                                    const PatternLanes& y) {
  using Lanes4 = Eigen::Array4f;
  constexpr std::ptrdiff_t kStride = sizeof(ImageSample) / sizeof(float);
  const auto load = [](const float* p) { return Eigen::Map<const Lanes4>(p); };
  const auto* image = reinterpret_cast<const float*>(level.data());
  const std::ptrdiff_t row = kStride * level.width();
  PatternSamples samples;
  for (Eigen::Index k = 0; k < kPatternSize; ++k) {
    const int ix = static_cast<int>(x[k]);
    const int iy = static_cast<int>(y[k]);
    const float fx = x[k] - static_cast<float>(ix);
    const float fy = y[k] - static_cast<float>(iy);
    const float w11 = fx * fy;
    const float w10 = fy - w11;
    const float w01 = fx - w11;
    const float w00 = 1.0F - fx - fy + w11;
    const float* top = image + iy * row + kStride * ix;
    const float* bottom = top + row;
    const Lanes4 value = w00 * load(top) + w01 * load(top + kStride) + w10 * load(bottom) +
                         w11 * load(bottom + kStride);
    samples.intensity[k] = value[0];
    samples.dx[k] = value[1];
    samples.dy[k] = value[2];
  }
  return samples;
}

}  // namespace dsorb
