// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace dsorb {

/// Evenly spread frames that an adjustment of a whole segment takes, both ends too.
constexpr std::size_t kAdjustedFrames = 6;

/// Indices of at most `count` frames, the reference counted, evenly spread over the frames after
/// it, the newest one included.
inline std::vector<std::size_t> spreadFrames(std::size_t frames, std::size_t count) {
  std::vector<std::size_t> chosen;
  const std::size_t last = frames - 1;
  const std::size_t steps = std::min(last, std::max<std::size_t>(count, 1) - 1);
  for (std::size_t step = 1; step <= steps; ++step)
    chosen.push_back((step * last + steps / 2) / steps);
  return chosen;
}

}  // namespace dsorb
