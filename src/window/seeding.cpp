// SPDX-License-Identifier: BSD-3-Clause
#include "window/seeding.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace dsorb::window {
namespace {

constexpr int kThinningRounds = 20;  // of the search for the cell size

/// Relative uncertainty, by which seeds compete for a cell.
float uncertainty(const MapPoint& point) {
  if (!(point.variance > 0)) return std::numeric_limits<float>::max();
  return point.variance / (point.inverse_depth * point.inverse_depth);
}

std::vector<std::size_t> bestOfCells(const std::vector<MapPoint>& points,
                                     int width,
                                     int height,
                                     double cell) {
  const int columns = static_cast<int>(width / cell) + 1;
  const int rows = static_cast<int>(height / cell) + 1;
  constexpr std::size_t kNone = std::numeric_limits<std::size_t>::max();
  std::vector<std::size_t> best(static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows),
                                kNone);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const std::ptrdiff_t x =
        std::clamp(static_cast<int>(points[i].pixel.x() / cell), 0, columns - 1);
    const std::ptrdiff_t y = std::clamp(static_cast<int>(points[i].pixel.y() / cell), 0, rows - 1);
    std::size_t& holder = best[static_cast<std::size_t>(y * columns + x)];
    if (holder == kNone || uncertainty(points[i]) < uncertainty(points[holder])) holder = i;
  }
  best.erase(std::remove(best.begin(), best.end(), kNone), best.end());
  std::sort(best.begin(), best.end());
  return best;
}

}  // namespace

std::vector<std::size_t> thinOnGrid(const std::vector<MapPoint>& points,
                                    int width,
                                    int height,
                                    int wanted) {
  const auto limit = static_cast<std::size_t>(std::max(wanted, 0));
  double fine = 1;  // [px] cell sides; the coarser one is known to give few enough points
  double coarse = std::max(width, height);
  std::vector<std::size_t> kept = bestOfCells(points, width, height, fine);
  if (kept.size() <= limit) return kept;
  std::vector<std::size_t> result;
  for (int i = 0; i < kThinningRounds; ++i) {
    const double middle = std::sqrt(fine * coarse);
    kept = bestOfCells(points, width, height, middle);
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
    const std::size_t newest = window.keyframes.size() - 1;
    for (std::size_t k = 0; k <= newest; ++k) {
      if (k == host) continue;
      point->addObservation(k);
      if (newest - k < point->recent.size()) {
        point->recent[newest - k] = {window.keyframes[k].id, ResidualState::kIn};
      }
    }
  }
  return added;
}

}  // namespace dsorb::window
