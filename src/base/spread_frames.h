// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <vector>

namespace dsorb {

/// Indices of at most `count` frames, the reference counted, evenly spread over the frames after
/// it, the newest one included.
inline std::vector<int> spreadFrames(int frames, int count) {
  std::vector<int> chosen;
  const int last = frames - 1;
  const int steps = std::min(last, count - 1);
  for (int step = 1; step <= steps; ++step) chosen.push_back((step * last + steps / 2) / steps);
  return chosen;
}

}  // namespace dsorb
