// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include <array>
#include <cstddef>

namespace dsorb {

struct PatternOffset {
  int x;
  int y;
};

/// The 8-pixel residual pattern: spread diamond without its lower-right diagonal pixel.
/// @source Engel et al., DSO, arXiv:1607.02565, fig. 4
constexpr std::array<PatternOffset, 8> kPattern = {
    {{0, -2}, {-1, -1}, {1, -1}, {-2, 0}, {0, 0}, {2, 0}, {-1, 1}, {0, 2}}};
constexpr int kPatternSize = 8;
constexpr int kPatternRadius = 2;          // [px]
constexpr std::size_t kPatternCenter = 4;  // index of the pixel itself

constexpr double kImageNoise = 2.8284;  // of one grey value: sqrt(8) [grey levels]

/// Robust energy of a pattern above which it is an outlier: 12 grey levels a pixel.
/// @source DSO as published
constexpr float kPatternOutlierEnergy = 12.0F * 12.0F * kPatternSize;

/// Weight that trusts strong gradients less: c^2 / (c^2 + |gradient|^2), c = 50 grey levels / px.
/// @source Engel et al., DSO, eq. (7)
inline float gradientWeight(float squared_gradient) {
  constexpr float kC2 = 50.0F * 50.0F;
  return kC2 / (kC2 + squared_gradient);
}

/// A pixel of a known frame whose inverse depth is known: what tracking needs of a map.
struct DepthSample {
  Eigen::Vector2f pixel{0, 0};  ///< level 0 [px]
  float inverse_depth = 0;      ///< [1/unit], for the frame's z
  float weight = 1;             ///< relative; square root of the inverse depth's information
};

}  // namespace dsorb
