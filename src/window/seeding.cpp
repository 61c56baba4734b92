// SPDX-License-Identifier: BSD-3-Clause
#include "window/seeding.h"

#include "image/cell_grid.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace dsorb::window {
namespace {

constexpr int kThinningRounds = 20;  // of the search for the cell size

/// Relative uncertainty, by which seeds compete for a cell.
float uncertainty(const MapPoint& point) {
  if (!(point.variance > 0)) return std::numeric_limits<float>::max();
  return point.variance / (point.inverse_depth * point.inverse_depth);
}

}  // namespace

std::vector<std::size_t> thinOnGrid(const std::vector<MapPoint>& points,
                                    int width,
                                    int height,
                                    int wanted) {
  const auto limit = static_cast<std::size_t>(std::max(wanted, 0));
  std::vector<std::size_t> all(points.size());
  std::iota(all.begin(), all.end(), std::size_t{0});
  const auto best_of_cells = [&](double cell) {
    return bestOfCells(
        CellGrid(width, height, cell),
        all,
        [&](std::size_t i) { return points[i].pixel; },
        [&](std::size_t a, std::size_t b) {
          return uncertainty(points[a]) < uncertainty(points[b]);
        });
  };
  double fine = 1;  // [px] cell sides; the coarser one is known to give few enough points
  double coarse = std::max(width, height);
  std::vector<std::size_t> kept = best_of_cells(fine);
  if (kept.size() <= limit) return kept;
  std::vector<std::size_t> result;
  for (int i = 0; i < kThinningRounds; ++i) {
    const double middle = std::sqrt(fine * coarse);
    kept = best_of_cells(middle);
    if (kept.size() > limit) {
      fine = middle;
    } else {
      coarse = middle;
      result = kept;
    }
  }
  return result;
}

float seedInformation(const MapPoint& point, const PriorOptions& options) {
  const auto limit = static_cast<float>(options.max_depth);
  if (!(point.variance > 0)) return 0;
  return std::min(static_cast<float>(options.depth_gain) / point.variance, limit);
}

int seedPoints(Window& window,
               std::size_t host,
               const std::vector<MapPoint>& points,
               const WindowOptions& options) {
  Keyframe& keyframe = window.keyframes[host];
  int added = 0;
  for (const MapPoint& seed : points) {
    WindowPoint* point = addPoint(
        window, keyframe, seed.pixel, seed.inverse_depth, seedInformation(seed, options.prior));
    if (point == nullptr) continue;
    ++added;
    addObservations(
        window, host, [](std::size_t) { return true; }, *point);
  }
  return added;
}

}  // namespace dsorb::window
