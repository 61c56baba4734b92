// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>

namespace dsorb {

/// Size of an image relative to 640x480, where options in pixels are meant: ratio of the diagonals.
inline double imageScale(int width, int height) {
  constexpr double kReferenceDiagonal = 800;  // [px]
  return std::hypot(width, height) / kReferenceDiagonal;
}

}  // namespace dsorb
