// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/frame.h"

#include "image/region_thresholds.h"

#include <cstddef>
#include <cstdint>
#include <vector>

namespace dsorb {

/// The scales at which each pixel of level 0 passes the threshold of its region: the pixel itself,
/// and the pixels of levels 1 and 2 that cover it, with lower thresholds. Memory is reused between
/// frames of one size.
/// @source Engel et al., DSO, arXiv:1607.02565, section 3.2; factors of DSO as published
class ScaleMap {
 public:
  /// Takes the memory for frames of one size; compute() does so where it has not been done.
  void resize(int width, int height);
  /// @param threshold_factor on squared gradients
  void compute(const Frame& frame, const RegionThresholds& thresholds, float threshold_factor);

  /// @return for each pixel of the row the sum of its scales: 1, 2 and 4 pixels
  [[nodiscard]] const std::uint8_t* row(int y) const {
    return scales_.data() + static_cast<std::ptrdiff_t>(y) * width_;
  }

 private:
  int width_ = 0;
  std::vector<std::uint8_t> scales_;
};

}  // namespace dsorb
