// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "image/photometric.h"

#include <Eigen/Core>

#include <array>

namespace dsorb {

/// The pattern of a point in the frame that hosts it, at some pyramid level.
struct HostPatch {
  Eigen::Vector2f ray{0, 0};                 ///< of its centre, at z = 1
  std::array<float, kPatternSize> grey{};    ///< [grey levels]
  std::array<float, kPatternSize> weight{};  ///< of each pixel's squared residual [-]
};

}  // namespace dsorb
