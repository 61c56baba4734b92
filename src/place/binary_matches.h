// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "place/binary_index.h"

#include <vector>

namespace dsorb::place {

/// Distance of two descriptors [bits].
[[nodiscard]] inline int distance(const BinaryDescriptor& a, const BinaryDescriptor& b) {
  return __builtin_popcountll(a[0] ^ b[0]) + __builtin_popcountll(a[1] ^ b[1]) +
         __builtin_popcountll(a[2] ^ b[2]) + __builtin_popcountll(a[3] ^ b[3]);
}

/// Partner of each descriptor of `from`, -1 without one: nearest to each other, near enough, and
/// clearly nearer than any rival, as partnersOf().
[[nodiscard]] std::vector<int> mutualMatches(const std::vector<BinaryDescriptor>& from,
                                             const std::vector<BinaryDescriptor>& to);

}  // namespace dsorb::place
