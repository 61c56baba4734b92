// SPDX-License-Identifier: BSD-3-Clause
#include "published/map.h"

#include "init/result.h"

#include <cmath>

namespace dsorb::published {

std::vector<SE3> Map::poses() const {
  std::vector<SE3> poses;
  for (std::size_t k = 1; k < frames.size(); ++k) poses.push_back(pose(k));
  return poses;
}

int removePoints(Map& map, const std::vector<char>& removed) {
  std::vector<std::size_t> new_index;
  std::vector<MapPoint> kept;
  const std::size_t before = map.corners;
  for (std::size_t i = 0; i < map.points.size(); ++i) {
    if (i == before) map.corners = kept.size();
    new_index.push_back(kept.size());
    if (removed[i] == 0) kept.push_back(map.points[i]);
  }
  if (before == map.points.size()) map.corners = kept.size();
  map.points = std::move(kept);
  std::vector<Observation> observations;
  for (const Observation& seen : map.observations) {
    if (removed[seen.corner] != 0) continue;
    observations.push_back({new_index[seen.corner], seen.frame, seen.pixel});
  }
  map.observations = std::move(observations);
  return static_cast<int>(before - map.corners);
}

bool normalizeScale(Map& map, std::size_t count) {
  double sum = 0;
  for (std::size_t i = 0; i < count; ++i) sum += map.points[i].inverse_depth;
  const double mean = sum / static_cast<double>(count);
  if (!(mean > 0) || !std::isfinite(mean)) return false;
  for (MapPoint& point : map.points) changeUnit(mean, point.inverse_depth, point.variance);
  changeUnit(mean, map.frames);
  return true;
}

}  // namespace dsorb::published
