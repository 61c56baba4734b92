// SPDX-License-Identifier: BSD-3-Clause
#include "io/input/bit_depth.h"

#include <fmt/format.h>

namespace dsorb {
namespace {

constexpr int kTypeBits = 16;
constexpr int kDarkBits = 14;  // up to here a whole image stays below a quarter of the range

}  // namespace

BitDepth recogniseBitDepth(std::uint16_t largest) {
  for (const int bits : {10, 12}) {
    if (largest >> static_cast<unsigned>(bits) != 0) continue;
    return {bits,
            fmt::format("16-bit images with values up to {} are taken for {}-bit ones; --bits 16 "
                        "takes them as they are",
                        largest,
                        bits)};
  }
  if (largest >> static_cast<unsigned>(kDarkBits) != 0) return {kTypeBits, ""};
  return {kTypeBits,
          fmt::format("16-bit images with values up to {} only; if the camera has fewer bits, say "
                      "how many with --bits",
                      largest)};
}

}  // namespace dsorb
