// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/init/result.h"

#include <cmath>
#include <cstddef>
#include <map>

namespace dsorb {

/// Puts a start into a map of points with observations, over the map's own types:
///
///     Keyframe addKeyframe(const dsorb::PosedFrame&);
///     Point addPoint(Keyframe host, const Eigen::Vector2d& pixel, const Eigen::Vector3d& position,
///                    const Eigen::Matrix3d& covariance);
///     void observe(Point, Keyframe, const Eigen::Vector2d& pixel);
///
/// All posed frames become keyframes. Positions are in the reference camera; covariances are along
/// the ray of the host, which counts as exact. What was measured is inside poses and depths
/// already, so the pixels observed are projections: where a descriptor of the host is to be looked
/// for.
template <typename Map>
void startFeatures(Map& map, const InitializationResult& start, const PinholeCamera& camera) {
  std::map<std::size_t, decltype(map.addKeyframe(start.frames[0]))> keyframes;
  for (std::size_t k = 0; k < start.frames.size(); ++k) {
    if (start.frames[k].T_cam_ref) keyframes.emplace(k, map.addKeyframe(start.frames[k]));
  }
  for (const InitPoint& point : start.points) {
    const auto host = static_cast<std::size_t>(point.host);
    const SE3 T_ref_host = start.frames[host].T_cam_ref->inverse();
    const Eigen::Vector2d pixel = point.pixel.cast<double>();
    const Eigen::Vector3d ray = camera.unproject(pixel);
    const double rho = point.inverse_depth;
    const Eigen::Vector3d along = T_ref_host.rotationMatrix() * ray / (rho * rho);
    const Eigen::Vector3d position = T_ref_host * (ray / rho);
    const auto added = map.addPoint(
        keyframes.at(host), pixel, position, point.variance * along * along.transpose());
    for (const auto& keyframe : keyframes) {
      const Eigen::Vector3d p = *start.frames[keyframe.first].T_cam_ref * position;
      const bool seen = p.z() > 0 && camera.contains(camera.project(p), 2);
      if (seen) map.observe(added, keyframe.second, camera.project(p));
    }
  }
}

/// Puts a start into a map of depth filters, a Gaussian of the inverse depth and a Beta
/// distribution of the share of good measurements each, over the map's own types:
///
///     Keyframe addKeyframe(const dsorb::PosedFrame&);
///     void addFilter(Keyframe, const Eigen::Vector2d& pixel, double mean, double variance,
///                    double good, double bad, bool converged);
///
/// A variance has what was measured in all frames: none of these is to be filtered again.
template <typename Map>
void startFilters(Map& map, const InitializationResult& start) {
  std::map<int, decltype(map.addKeyframe(start.frames[0]))> hosts;
  for (const InitPoint& p : start.points) {
    auto host = hosts.find(p.host);
    if (host == hosts.end()) {
      const PosedFrame& posed = start.frames[static_cast<std::size_t>(p.host)];
      host = hosts.emplace(p.host, map.addKeyframe(posed)).first;
    }
    const double good = 10.0 + p.observations, bad = 10;
    const bool converged = std::sqrt(p.variance) < 0.1F * p.inverse_depth;  // a point of the map
    map.addFilter(
        host->second, p.pixel.cast<double>(), p.inverse_depth, p.variance, good, bad, converged);
  }
}

}  // namespace dsorb
