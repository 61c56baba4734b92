// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/initial_map.h"

#include <cmath>
#include <cstddef>

namespace dsorb::init_orb {

void removeCorners(InitialMap& map, const std::vector<char>& removed) {
  std::vector<int> new_index(map.corners.size(), -1);
  std::size_t kept = 0;
  for (std::size_t i = 0; i < map.corners.size(); ++i) {
    if (removed[i] != 0) continue;
    new_index[i] = static_cast<int>(kept);
    map.corners[kept++] = map.corners[i];
  }
  map.corners.resize(kept);
  kept = 0;
  for (const Observation& observation : map.observations) {
    const int corner = new_index[static_cast<std::size_t>(observation.corner)];
    if (corner < 0) continue;
    map.observations[kept] = observation;
    map.observations[kept++].corner = corner;
  }
  map.observations.resize(kept);
}

bool normalizeScale(InitialMap& map) {
  double mean = 0;
  for (const Corner& corner : map.corners) {
    mean += corner.inverse_depth / static_cast<double>(map.corners.size());
  }
  if (!(mean > 0) || !std::isfinite(mean)) {
    return false;
  }
  for (Corner& corner : map.corners) {
    corner.inverse_depth /= mean;
  }
  for (SemiDensePoint& point : map.points) {
    point.inverse_depth /= static_cast<float>(mean);
    point.variance /= static_cast<float>(mean * mean);
  }
  for (std::optional<SE3>& pose : map.T_cam_ref) {
    if (pose) {
      pose->setTranslation(pose->translation() * mean);
    }
  }
  return true;
}

}  // namespace dsorb::init_orb
