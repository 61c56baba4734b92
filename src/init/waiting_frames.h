// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/frame.h"
#include "dsorb/image/frame_priors.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

/// Frames that wait for a start: large ones share a budget of memory, and those between that are
/// missed least are forgotten.
namespace dsorb {

/// Reference, newest and one between, without which an adjustment shows no contradiction. Only from
/// four on can those between be spread.
constexpr std::size_t kLeastWaiting = 3;

/// How many frames as large as this one fit into a budget, at least kLeastWaiting.
inline std::size_t waitingFrames(const Frame& frame, int budget_mb) {
  const double pixels = static_cast<double>(frame.width()) * frame.height();
  const bool knows_depth = frame.priors() != nullptr && frame.priors()->depth;
  const double bytes = 4.0 / 3 * sizeof(float) * pixels +  // of all levels
                       (knows_depth ? 2 * sizeof(float) * pixels : 0);
  const auto fitting = static_cast<std::size_t>(budget_mb * 1024.0 * 1024.0 / bytes);
  return std::max(fitting, kLeastWaiting);
}

/// Index of the frame without which the largest step in time grows least; neither the first nor the
/// last. @param frames at least three, @param frame_at gives one of them
template <typename Frames, typename FrameAt>
std::size_t leastMissed(const Frames& frames, const FrameAt& frame_at) {
  const auto gap = [&](std::size_t k) {
    return std::abs(frame_at(frames[k + 1]).timestamp() - frame_at(frames[k - 1]).timestamp());
  };
  std::size_t least = 1;
  for (std::size_t k = 2; k + 1 < frames.size(); ++k) {
    if (gap(k) < gap(least)) least = k;
  }
  return least;
}

}  // namespace dsorb
