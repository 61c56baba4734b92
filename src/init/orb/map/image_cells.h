// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"

#include <Eigen/Core>

#include <algorithm>
#include <cstddef>

namespace dsorb::init_orb {

constexpr int kCellsX = 10;  // of the image; errors inside a cell count as one
constexpr int kCellsY = 8;

/// Row by row. @param pixel clamped into the image
inline std::size_t imageCell(const Eigen::Vector2d& pixel, const PinholeCamera& camera) {
  const auto index = [](double position, int size, int cells) {
    return static_cast<std::size_t>(
        std::clamp(static_cast<int>(position * cells / size), 0, cells - 1));
  };
  return index(pixel.y(), camera.height, kCellsY) * kCellsX +
         index(pixel.x(), camera.width, kCellsX);
}

}  // namespace dsorb::init_orb
