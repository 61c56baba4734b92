// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "image/cell_grid.h"
#include "image/image_scale.h"
#include "image/pixel_selector.h"

#include <Eigen/Core>

#include <algorithm>
#include <vector>

namespace dsorb {

/// Squares of the image in which something moves with the camera.
class StuckRegions {
 public:
  StuckRegions() = default;  ///< none
  /// @param pixels that were seen to move with the camera
  StuckRegions(const std::vector<Eigen::Vector2f>& pixels, int width, int height)
      : grid_(width, height, kSide * imageScale(width, height)) {
    if (pixels.empty()) return;
    stuck_.assign(grid_.size(), 0);
    for (const Eigen::Vector2f& pixel : pixels) stuck_[grid_.at(pixel.x(), pixel.y())] = 1;
  }

  void removeFrom(std::vector<SelectedPixel>& selected) const {
    if (stuck_.empty()) return;
    const auto is_stuck = [&](const SelectedPixel& p) { return stuck_[grid_.at(p.x, p.y)] != 0; };
    selected.erase(std::remove_if(selected.begin(), selected.end(), is_stuck), selected.end());
  }

 private:
  static constexpr double kSide = 32;  // for an image diagonal of 800 px [px]

  CellGrid grid_{1, 1, kSide};
  std::vector<char> stuck_;
};

}  // namespace dsorb
