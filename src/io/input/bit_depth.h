// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <string>

namespace dsorb {

/// How many bits the values of 16-bit images take, and what the user should know of it.
struct BitDepth {
  int bits = 16;
  std::string warning;  ///< empty: none
};

/// Cameras of 10 and 12 bits write 16-bit files; taken for what the type can hold, their images
/// are nearly black.
/// @param largest of the values of several images
[[nodiscard]] BitDepth recogniseBitDepth(std::uint16_t largest);

}  // namespace dsorb
