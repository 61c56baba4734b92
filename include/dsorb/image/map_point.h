// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/cxx17.h"

#include <Eigen/Core>

namespace dsorb {

/// A point of the map, hosted in a frame that its owner knows.
struct MapPoint {
  Eigen::Vector2f pixel{0, 0};  ///< position in the host, level 0 [px]
  float inverse_depth = 0;      ///< inverse of the host camera's z [1/unit]
  float variance = 0;           ///< variance of the inverse depth [1/unit^2]; 0 stands for unknown
  float intensity = 0;          ///< grey of the pixel [grey levels]
};

}  // namespace dsorb
