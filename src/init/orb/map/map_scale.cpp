// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/map/map_scale.h"

#include "init/result.h"

#include <cmath>

namespace dsorb::init_orb {

namespace {

/// Makes this inverse depth 1. @return false when it is not positive
bool rescale(InitialMap& map, double mean) {
  if (!(mean > 0) || !std::isfinite(mean)) return false;
  for (Corner& corner : map.corners) changeUnit(mean, corner.inverse_depth, corner.variance);
  for (SemiDensePoint& point : map.points) changeUnit(mean, point.inverse_depth, point.variance);
  changeUnit(mean, map.frames);
  for (Eigen::Index row = 0; row < map.joint_covariance.rows(); ++row) {
    if (row % 6 >= 3) continue;  // a rotation
    map.joint_covariance.row(row) *= mean;
    map.joint_covariance.col(row) *= mean;
  }
  return true;
}

}  // namespace

bool normalizeCornerScale(InitialMap& map) {
  double mean = 0;
  for (const Corner& corner : map.corners) {
    mean += corner.inverse_depth / static_cast<double>(map.corners.size());
  }
  return rescale(map, mean);
}

bool normalizeMapScale(InitialMap& map) {
  double sum = 0;
  for (const Corner& corner : map.corners) sum += corner.inverse_depth;
  for (const SemiDensePoint& point : map.points) sum += static_cast<double>(point.inverse_depth);
  return rescale(map, sum / static_cast<double>(map.corners.size() + map.points.size()));
}

}  // namespace dsorb::init_orb
