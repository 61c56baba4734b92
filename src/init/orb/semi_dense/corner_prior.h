// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/options/orb_mapping.h"

#include "init/orb/map/initial_map.h"

#include <vector>

namespace dsorb::init_orb {

/// Inverse depth as a Gaussian.
struct DepthEstimate {
  float inverse_depth = 0;  ///< [1/unit]
  float variance = 0;       ///< [1/unit^2]
};

/// Guesses the inverse depth of any pixel of the reference from the corners around it.
class CornerPrior {
 public:
  /// @param corners adjusted, at least one
  CornerPrior(const std::vector<Corner>& corners,
              int width,
              int height,
              const SemiDenseOptions& options);

  /// Mean of the nearest corners weighted by 1 / distance, with their spread and their own
  /// variances. With fewer than 3 corners close by: a Gaussian whose searched interval is the range
  /// of all corners, widened by a factor 2 at both ends.
  [[nodiscard]] DepthEstimate at(const Eigen::Vector2f& pixel) const;

 private:
  struct Entry {
    Eigen::Vector2f pixel;
    float inverse_depth;
    float variance;
  };
  static constexpr int kMaxNeighbours = 32;  // upper end of the option's range
  struct Neighbours {
    int count = 0;
    float squared_distance[kMaxNeighbours];
    const Entry* entry[kMaxNeighbours];
  };

  void collectCell(int cell_x, int cell_y, const Eigen::Vector2f& pixel, Neighbours& out) const;
  [[nodiscard]] Neighbours nearest(const Eigen::Vector2f& pixel) const;

  int wanted_;
  float radius_;
  float min_relative_sigma_;
  int cells_x_;
  int cells_y_;
  std::vector<Entry> entries_;    ///< sorted by cell
  std::vector<int> first_entry_;  ///< by cell, one more at the end
  DepthEstimate wide_;
};

}  // namespace dsorb::init_orb
