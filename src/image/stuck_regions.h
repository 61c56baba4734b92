// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "image/pixel_selector.h"

#include <Eigen/Core>

#include <algorithm>
#include <cstddef>
#include <vector>

namespace dsorb {

/// Squares of the image in which something moves with the camera.
class StuckRegions {
 public:
  StuckRegions() = default;  ///< none
  /// @param pixels that were seen to move with the camera
  StuckRegions(const std::vector<Eigen::Vector2f>& pixels, int width, int height)
      : columns_(width / kSide + 1) {
    if (pixels.empty()) return;
    const int rows = height / kSide + 1;
    stuck_.assign(static_cast<std::size_t>(rows) * static_cast<std::size_t>(columns_), 0);
    for (const Eigen::Vector2f& pixel : pixels) {
      const int x = std::clamp(static_cast<int>(pixel.x()), 0, width - 1);
      const int y = std::clamp(static_cast<int>(pixel.y()), 0, height - 1);
      stuck_[index(x, y)] = 1;
    }
  }

  void removeFrom(std::vector<SelectedPixel>& selected) const {
    if (stuck_.empty()) return;
    const auto is_stuck = [&](const SelectedPixel& p) { return stuck_[index(p.x, p.y)] != 0; };
    selected.erase(std::remove_if(selected.begin(), selected.end(), is_stuck), selected.end());
  }

 private:
  static constexpr int kSide = 32;  // [px]
  [[nodiscard]] std::size_t index(int x, int y) const {
    return static_cast<std::size_t>(y / kSide) * static_cast<std::size_t>(columns_) +
           static_cast<std::size_t>(x / kSide);
  }

  int columns_ = 0;
  std::vector<char> stuck_;
};

}  // namespace dsorb
