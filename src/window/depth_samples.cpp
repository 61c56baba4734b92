// SPDX-License-Identifier: BSD-3-Clause
#include "window/depth_samples.h"

#include "estimate/epipolar_geometry.h"

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>

namespace dsorb::window {
namespace {

constexpr float kWeightScale = 1e-3F;    // @source DSO as published
constexpr float kWeightOffset = 1e-12F;  // @source DSO as published

std::optional<DepthSample> sampleOf(const WindowPoint& point, const EpipolarGeometry& geometry) {
  const Eigen::Vector3f p = geometry.at(point.patch.pixel, point.inverse_depth);
  const float inverse_depth = point.inverse_depth / p.z();
  if (!(p.z() > 0) || !(inverse_depth > 0) || !(point.information > 0)) return std::nullopt;
  const float variance = 1.0F / point.information;
  return DepthSample{
      p.hnormalized(), inverse_depth, std::sqrt(kWeightScale / (variance + kWeightOffset))};
}

/// Pixels of a pinhole camera at the time of the middle row to those that the image shows.
void moveToRows(const Window& window, std::vector<DepthSample>& samples) {
  const std::optional<RollingShutter> shutter = window.shutter(window.keyframes.back());
  if (!shutter) return;
  const PinholeCamera camera = window.camera();
  for (DepthSample& sample : samples) {
    sample.pixel = pixelInRow(*shutter, camera, sample.pixel, sample.inverse_depth);
  }
}

}  // namespace

std::vector<DepthSample> depthSamples(const Window& window, const WindowOptions& options) {
  std::vector<DepthSample> samples;
  const std::size_t newest = window.keyframes.size() - 1;
  const auto pose = [&](const Keyframe& keyframe) {
    return options.current_reference ? keyframe.T_cam_world() : keyframe.T_cam_world_first;
  };
  for (std::size_t host = 0; host < newest; ++host) {
    const Keyframe& keyframe = window.keyframes[host];
    const EpipolarGeometry geometry(window.camera(),
                                    pose(window.keyframes[newest]) * pose(keyframe).inverse());
    for (const WindowPoint& point : keyframe.points) {
      const bool seen = std::any_of(point.begin(), point.end(), [&](const Observation& o) {
        return o.target == newest && o.state == ResidualState::kIn;
      });
      const auto sample = seen ? sampleOf(point, geometry) : std::nullopt;
      if (sample) samples.push_back(*sample);
    }
  }
  moveToRows(window, samples);
  return samples;
}

}  // namespace dsorb::window
