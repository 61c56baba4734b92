// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/map/initial_map.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

namespace dsorb::init_orb {
namespace {

bool handedOver(double inverse_depth, double variance) {
  return std::isfinite(inverse_depth) && inverse_depth > 0 && std::isfinite(variance) &&
         variance > 0;
}

}  // namespace

Eigen::Index jointRow(const InitialMap& map, std::size_t frame) {
  const auto found =
      std::find(map.joint_frames.begin(), map.joint_frames.end(), static_cast<int>(frame));
  return found == map.joint_frames.end() ? -1 : 6 * (found - map.joint_frames.begin());
}

void setJointCovariance(InitialMap& map, std::vector<int> frames, const Eigen::MatrixXd& joint) {
  map.joint_frames = std::move(frames);
  map.joint_covariance = joint;
  Eigen::Index row = 0;
  for (const int frame : map.joint_frames) {
    map.frames[static_cast<std::size_t>(frame)].covariance = joint.block<6, 6>(row, row);
    row += 6;
  }
}

void removeCorners(InitialMap& map, const std::vector<char>& removed) {
  std::vector<int> new_index(map.corners.size(), -1);
  int next = 0;
  for (std::size_t i = 0; i < map.corners.size(); ++i) {
    if (removed[i] == 0) new_index[i] = next++;
  }
  eraseMarked(removed, map.corners);
  std::size_t kept = 0;
  for (const Observation& observation : map.observations) {
    const int corner = new_index[static_cast<std::size_t>(observation.corner)];
    if (corner < 0) continue;
    map.observations[kept] = observation;
    map.observations[kept++].corner = corner;
  }
  map.observations.resize(kept);
}

std::vector<InitPoint> pointsOf(const InitialMap& map) {
  std::vector<int> observations(map.corners.size(), 0);
  for (const Observation& observation : map.observations) {
    ++observations[static_cast<std::size_t>(observation.corner)];
  }
  std::vector<InitPoint> points;
  for (std::size_t i = 0; i < map.corners.size(); ++i) {
    const Corner& corner = map.corners[i];
    if (!handedOver(corner.inverse_depth, corner.variance)) continue;
    points.push_back({0,
                      corner.pixel.cast<float>(),
                      static_cast<float>(corner.inverse_depth),
                      static_cast<float>(corner.variance),
                      observations[i]});
  }
  for (const SemiDensePoint& point : map.points) {
    if (!handedOver(point.inverse_depth, point.variance)) continue;
    points.push_back({0, point.pixel, point.inverse_depth, point.variance, point.observations});
  }
  return points;
}

}  // namespace dsorb::init_orb
