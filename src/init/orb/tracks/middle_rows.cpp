// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/tracks/middle_rows.h"

#include "dsorb/camera/row_times.h"

#include "estimate/rolling_shutter.h"

#include <algorithm>
#include <array>
#include <cstddef>

namespace dsorb::init_orb {
namespace {

constexpr std::size_t kNodes = 3;  // of a parabola

/// Position at a time, by the parabola through three [px].
Eigen::Vector2d interpolate(const std::array<Eigen::Vector2d, kNodes>& positions,
                            const std::array<double, kNodes>& times,
                            double time) {
  Eigen::Vector2d sum(0, 0);
  for (std::size_t i = 0; i < kNodes; ++i) {
    double weight = 1;
    for (std::size_t j = 0; j < kNodes; ++j) {
      if (j != i) weight *= (time - times[j]) / (times[i] - times[j]);
    }
    sum += weight * positions[i];
  }
  return sum;
}

}  // namespace

CornerTracks atMiddleRows(CornerTracks tracks,
                          const std::vector<FramePtr>& frames,
                          double readout_change) {
  if (frames.size() < kNodes) return tracks;
  tracks.seen = tracks.positions.front();
  const std::vector<std::vector<Eigen::Vector2f>> seen = tracks.positions;
  std::vector<RowTimes> rows;
  rows.reserve(frames.size());
  for (const FramePtr& frame : frames) rows.push_back(rowTimesOf(*frame, readout_change));
  for (std::size_t k = 0; k < frames.size(); ++k) {
    const std::size_t first = std::clamp<std::size_t>(k, 1, frames.size() - 2) - 1;
    for (std::size_t i = 0; i < seen[k].size(); ++i) {
      std::array<Eigen::Vector2d, kNodes> positions;
      std::array<double, kNodes> times{};
      for (std::size_t n = 0; n < kNodes; ++n) {
        const Frame& frame = *frames[first + n];
        positions[n] = seen[first + n][i].cast<double>();
        times[n] = frame.timestamp() + rows[first + n].at(positions[n].x(), positions[n].y());
      }
      const Eigen::Vector2d moved = interpolate(positions, times, frames[k]->timestamp());
      if (moved.allFinite()) tracks.positions[k][i] = moved.cast<float>();
    }
  }
  return tracks;
}

}  // namespace dsorb::init_orb
