// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <string>

namespace dsorb {

constexpr int kSizeUnit = 16;  // [px] four halvings make five levels

constexpr std::int64_t kMaxOutputPixels = std::int64_t{1} << 26;  // a map takes 12 bytes for each

inline int roundedDown(int size) {
  return size / kSizeUnit * kSizeUnit;
}

/// A size as messages have it, for example "640x480".
inline std::string sizeText(int width, int height) {
  return std::to_string(width) + "x" + std::to_string(height);
}

}  // namespace dsorb
