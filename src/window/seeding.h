// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/map_point.h"
#include "dsorb/options/window.h"

#include "window/window.h"

#include <cstddef>
#include <vector>

namespace dsorb::window {

/// Thins the points of one host to about the wanted number: one in a cell of a grid, the most
/// certain.
/// @return indices of the kept points, ascending
[[nodiscard]] std::vector<std::size_t> thinOnGrid(const std::vector<MapPoint>& points,
                                                  int width,
                                                  int height,
                                                  int wanted);

/// Prior information of a seed: 1 / variance, limited by the options.
[[nodiscard]] float seedInformation(const MapPoint& point, const PriorOptions& options);

/// Makes window points of a keyframe out of seeds; the keyframes added later get residuals to them
/// by addKeyframe, those already there get them here.
/// @return how many; points whose pattern leaves the image are left out
int seedPoints(Window& window,
               std::size_t host,
               const std::vector<MapPoint>& points,
               const WindowOptions& options);

}  // namespace dsorb::window
