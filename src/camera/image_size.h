// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

namespace dsorb {

constexpr int kSizeUnit = 16;  // [px] four halvings make five levels

inline int roundedDown(int size) {
  return size / kSizeUnit * kSizeUnit;
}

/// For messages, for example "640x480".
inline std::string sizeText(int width, int height) {
  return std::to_string(width) + "x" + std::to_string(height);
}

}  // namespace dsorb
