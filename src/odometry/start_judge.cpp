// SPDX-License-Identifier: BSD-3-Clause
#include "odometry/start_judge.h"

#include "base/median.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <utility>

namespace dsorb::odometry {
namespace {

constexpr double kDegrees = 57.29577951308232;   // of a radian
constexpr double kChi2Median = 0.4549364231195;  // with one degree of freedom

// Limits of a start that stays; docs/experiments.md, "Wrong starts", has what they were chosen on.
constexpr double kMaxDirection = 8;      // [deg]
constexpr double kMaxDepthSpread = .02;  // below it neither variances nor lost points matter
constexpr double kMaxDepthChange = 3;
constexpr double kMinKeptShare = .7;

// A wrong map leaves large residuals and seems unsure of everything; no right one left more. [grey
// levels]
constexpr double kMaxNoise = 7;

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

/// Place of a keyframe's camera as the reference sees it.
Eigen::Vector3d place(const SE3& T_cam_world, const SE3& T_reference_world) {
  return (T_reference_world * T_cam_world.inverse()).translation();
}

double angleDeg(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return kDegrees * std::atan2(a.cross(b).norm(), a.dot(b));
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
      points_.push_back({point.id, inverse_depth, variance / (inverse_depth * inverse_depth)});
    }
  }
}

StartChange StartComparison::change(const window::Window& adjusted, double noise) const {
  StartChange change;
  const SE3& reference = T_cam_world_.front();
  const SE3 reference_after = adjusted.keyframes.front().T_cam_world();
  double farthest = 0;
  for (std::size_t k = 1; k < T_cam_world_.size(); ++k) {
    const Eigen::Vector3d before = place(T_cam_world_[k], reference);
    if (before.norm() <= farthest) continue;
    farthest = before.norm();
    change.direction_deg =
        angleDeg(before, place(adjusted.keyframes[k].T_cam_world(), reference_after));
  }
  const std::map<int, Adjusted> after = adjustedPoints(adjusted);
  const double variance = std::min(noise, kMaxNoise) * std::min(noise, kMaxNoise);
  std::vector<double> logarithms;
  std::vector<double> variances;
  for (const Point& point : points_) {
    const auto found = after.find(point.id.value);
    if (found == after.end()) continue;
    const auto [inverse_depth, information] = found->second;
    logarithms.push_back(std::log(inverse_depth / point.inverse_depth));
    variances.push_back(point.relative_variance +
                        variance / (information * inverse_depth * inverse_depth));
  }
  if (logarithms.empty()) return change;
  change.kept_share = static_cast<double>(logarithms.size()) / static_cast<double>(points_.size());
  std::vector<double> values = logarithms;
  const double scale = medianInPlace(values);
  std::vector<double> normalized;
  for (std::size_t i = 0; i < values.size(); ++i) {
    const double distance = logarithms[i] - scale;
    values[i] = std::abs(distance);
    normalized.push_back(distance * distance / variances[i]);
  }
  change.depth_spread = kMadToSigma * medianInPlace(values);
  change.depth_change = medianInPlace(normalized) / kChi2Median;
  return change;
}

std::optional<RefusalReason> refusalOf(const StartChange& change) {
  if (!(change.direction_deg <= kMaxDirection)) return RefusalReason::kDirection;
  const bool same_depths = change.depth_spread <= kMaxDepthSpread;
  const bool allowed = change.depth_change <= kMaxDepthChange && change.kept_share >= kMinKeptShare;
  return same_depths || allowed ? std::nullopt : std::optional(RefusalReason::kDepth);
}

}  // namespace dsorb::odometry
