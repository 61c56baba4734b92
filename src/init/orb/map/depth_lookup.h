// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/frame_priors.h"

#include "init/orb/map/initial_map.h"

#include <Eigen/Core>

namespace dsorb::init_orb {

/// Reads the inverse depth at any pixel from a frame's known depths. Refers to them.
class DepthLookup {
 public:
  /// @param metres    of a unit
  /// @param inflation of the claimed standard deviations [-]
  DepthLookup(const DepthPrior& prior, double metres, double inflation)
      : prior_(prior), metres_(metres), inflation_(inflation) {}

  /// The depth of the pixel with the spread of its eight neighbours, which is wide at an edge of
  /// depth; where the pixel has none, the mean of the known ones within a few pixels, as wide as a
  /// guess. Nothing where there are none, either.
  [[nodiscard]] KnownInverseDepth at(const Eigen::Vector2f& pixel) const;

 private:
  const DepthPrior& prior_;
  double metres_;
  double inflation_;
};

}  // namespace dsorb::init_orb
