// SPDX-License-Identifier: BSD-3-Clause
#include "odometry/start_comparison.h"

#include "estimate/host_patch.h"
#include "estimate/warp.h"

#include <algorithm>
#include <cstddef>
#include <map>
#include <utility>

namespace dsorb::odometry {
namespace {

using Pixel = std::pair<float, float>;

/// A point of the adjusted window.
struct Adjusted {
  double inverse_depth = 0;
  double information = 0;  ///< of the inverse depth, times the variance of a grey value
};

/// All points that are still in use, by their ids.
std::map<int, Adjusted> adjustedPoints(const window::Window& window) {
  std::map<int, Adjusted> points;
  const auto add = [&](const window::WindowPoint& point) {
    if (!(point.inverse_depth > 0) || !(point.information > 0)) return;
    points[point.id.value] = {static_cast<double>(point.inverse_depth),
                              static_cast<double>(point.information)};
  };
  for (const window::Keyframe& keyframe : window.keyframes) {
    for (const window::WindowPoint& point : keyframe.points) add(point);
    for (const window::WindowPoint& point : keyframe.marginalized) add(point);
  }
  return points;
}

/// Whether the newest keyframe sees a point of another one. A window drops what it does not see.
bool newestSees(const window::Window& window,
                const window::Keyframe& host,
                const window::WindowPoint& point) {
  const window::Keyframe& newest = window.keyframes.back();
  const PinholeCamera camera = window.camera();
  const auto projection = projectHosted(camera,
                                        newest.T_cam_world() * host.T_cam_world().inverse(),
                                        camera.unproject(point.patch.pixel.cast<double>()),
                                        static_cast<double>(point.inverse_depth));
  return projection && canSample(newest.frame->level(0),
                                 static_cast<float>(projection->pixel.x()),
                                 static_cast<float>(projection->pixel.y()),
                                 kPatternRadius);
}

}  // namespace

StartComparison::StartComparison(const InitializationResult& result, const window::Window& seeded) {
  for (const window::Keyframe& keyframe : seeded.keyframes) {
    T_cam_world_.push_back(keyframe.T_cam_world());
    std::map<Pixel, const InitPoint*> hosted;
    for (const InitPoint& point : result.points) {
      if (result.frames[static_cast<std::size_t>(point.host)].frame != keyframe.frame) continue;
      hosted[{point.pixel.x(), point.pixel.y()}] = &point;
    }
    for (const window::WindowPoint& point : keyframe.points) {
      const auto initial = hosted.find({point.patch.seen.x(), point.patch.seen.y()});
      if (initial == hosted.end()) continue;  // the window's own
      const auto inverse_depth = static_cast<double>(initial->second->inverse_depth);
      const auto variance = static_cast<double>(initial->second->variance);
      if (!(inverse_depth > 0)) continue;
      points_.push_back({point.id, inverse_depth, variance, newestSees(seeded, keyframe, point)});
    }
  }
}

StartChange StartComparison::change(const window::Window& adjusted, double noise) const {
  const SE3 T_ref_world = T_cam_world_.front().inverse();
  const SE3 T_ref_world_after = adjusted.keyframes.front().T_cam_world().inverse();
  std::vector<StartPose> poses;
  for (std::size_t k = 1; k < T_cam_world_.size(); ++k) {
    poses.push_back(
        {T_cam_world_[k] * T_ref_world, adjusted.keyframes[k].T_cam_world() * T_ref_world_after});
  }
  const std::map<int, Adjusted> after = adjustedPoints(adjusted);
  const double limited = std::min(noise, kMaxStartNoise);
  std::vector<StartPoint> points;
  for (const Point& point : points_) {
    const auto found = after.find(point.id.value);
    if (found == after.end() && !point.stays) continue;
    StartPoint& change = points.emplace_back();
    change.inverse_depth = point.inverse_depth;
    change.variance = point.variance;
    if (found == after.end()) continue;
    change.adjusted = found->second.inverse_depth;
    change.adjusted_variance = limited * limited / found->second.information;
  }
  return startChange(poses, points);
}

}  // namespace dsorb::odometry
