// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "image/cell_grid.h"
#include "init/orb/map/initial_map.h"

#include <vector>

namespace dsorb::init_orb {

constexpr float kMinPriorSigma = 0.1F;  ///< of a prior, relative to its inverse depth [-]
constexpr float kSearchSigmas = 2;      ///< half length of the searched interval [sigma]

/// Guesses the inverse depth of any pixel of the reference from the corners around it.
class CornerPrior {
 public:
  /// @param corners adjusted, at least one
  CornerPrior(const std::vector<Corner>& corners, int width, int height);

  /// Mean of the nearest corners weighted by 1 / distance, with their spread and their own
  /// variances. With fewer than 3 corners close by it is a Gaussian whose searched interval is the
  /// range of all corners, widened by a factor 2 at both ends.
  [[nodiscard]] SemiDensePoint at(const Eigen::Vector2f& pixel) const;

 private:
  float radius_;                        ///< within which corners count [px]
  PointGrid grid_;                      ///< the corners
  std::vector<SemiDensePoint> depths_;  ///< inverse depths of the corners
  SemiDensePoint wide_;                 ///< without a pixel
};

}  // namespace dsorb::init_orb
