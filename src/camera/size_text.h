// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

namespace dsorb {

/// For messages, for example "640x480".
inline std::string sizeText(int width, int height) {
  return std::to_string(width) + "x" + std::to_string(height);
}

}  // namespace dsorb
