// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/options/window.h"

#include "window/window.h"

#include <Eigen/Core>

#include <cstddef>
#include <vector>

namespace dsorb::window {

/// A point an initialization knows: pixel in its host, inverse depth and its variance.
struct SeedPoint {
  Eigen::Vector2f pixel{0, 0};  ///< level 0 [px]
  float inverse_depth = 0;      ///< [1/unit]
  float variance = 0;           ///< [1/unit^2]; 0: unknown
};

/// Thins points to about the wanted number: at most one in a cell of a grid, the most certain.
/// @return indices of the kept points, ascending
[[nodiscard]] std::vector<std::size_t> thinOnGrid(const std::vector<SeedPoint>& points,
                                                  int width,
                                                  int height,
                                                  int wanted);

/// Prior information of a seed: 1 / variance, limited by the options.
[[nodiscard]] float seedInformation(const SeedPoint& point, const PriorOptions& options);

/// Makes window points of a keyframe out of seeds; the keyframes added later get residuals to them
/// by addKeyframe, those already there get them here.
/// @return how many; points whose pattern leaves the image are left out
int seedPoints(Window& window,
               std::size_t host,
               const std::vector<SeedPoint>& points,
               const WindowOptions& options);

}  // namespace dsorb::window
