// SPDX-License-Identifier: BSD-3-Clause
#include "features/middle_rows.h"

#include "dsorb/camera/row_times.h"

#include "estimate/rolling_shutter.h"

#include <algorithm>
#include <cstddef>

namespace dsorb {
namespace {

constexpr std::size_t kNodes = 3;  // of a parabola

/// A corner where a row saw it.
struct RowObservation {
  std::size_t frame = 0;
  double time = 0;  ///< of the row [s]
  Eigen::Vector2d position{0, 0};
};

/// Position at a time, by the polynomial through some observations [px].
Eigen::Vector2d interpolate(const RowObservation* nodes, std::size_t count, double time) {
  Eigen::Vector2d sum(0, 0);
  for (std::size_t i = 0; i < count; ++i) {
    double weight = 1;
    for (std::size_t j = 0; j < count; ++j) {
      if (j != i) weight *= (time - nodes[j].time) / (nodes[i].time - nodes[j].time);
    }
    sum += weight * nodes[i].position;
  }
  return sum;
}

}  // namespace

CornerTracks atMiddleRows(CornerTracks tracks,
                          const std::vector<FramePtr>& frames,
                          double readout_change) {
  if (frames.size() < kNodes) return tracks;
  tracks.seen = tracks.positions.front();
  std::vector<RowTimes> rows;
  rows.reserve(frames.size());
  for (const FramePtr& frame : frames) rows.push_back(rowTimesOf(*frame, readout_change));
  std::vector<RowObservation> observations;
  for (std::size_t i = 0; i < tracks.seen.size(); ++i) {
    observations.clear();
    for (std::size_t k = 0; k < frames.size(); ++k) {
      const Eigen::Vector2d position = tracks.positions[k][i].cast<double>();
      if (!position.allFinite()) continue;
      observations.push_back(
          {k, frames[k]->timestamp() + rows[k].at(position.x(), position.y()), position});
    }
    const std::size_t nodes = std::min(kNodes, observations.size());
    for (std::size_t s = 0; s < observations.size(); ++s) {
      const std::size_t first = std::clamp<std::size_t>(s, 1, observations.size() + 1 - nodes) - 1;
      const std::size_t frame = observations[s].frame;
      tracks.positions[frame][i] =
          interpolate(&observations[first], nodes, frames[frame]->timestamp()).cast<float>();
    }
  }
  return tracks;
}

}  // namespace dsorb
