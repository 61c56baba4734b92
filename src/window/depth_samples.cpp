// SPDX-License-Identifier: BSD-3-Clause
#include "window/depth_samples.h"

#include "window/pair_geometry.h"

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

std::optional<DepthSample> sampleOf(const WindowPoint& point,
                                    const Eigen::Matrix3f& KRKi,
                                    const Eigen::Vector3f& Kt) {
  const Eigen::Vector3f p = KRKi * point.pixel.homogeneous() + Kt * point.inverse_depth;
  const float inverse_depth = point.inverse_depth / p.z();
  if (!(p.z() > 0) || !(inverse_depth > 0) || !(point.information > 0)) return std::nullopt;
  const float variance = 1.0F / point.information;
  return DepthSample{
      p.hnormalized(), inverse_depth, std::sqrt(kWeightScale / (variance + kWeightOffset))};
}

}  // namespace

std::vector<DepthSample> depthSamples(const Window& window, const WindowOptions& options) {
  std::vector<DepthSample> samples;
  const std::size_t newest = window.keyframes.size() - 1;
  const PairTable pairs(window);
  const Eigen::Matrix3f K = window.camera().matrix().cast<float>();
  for (std::size_t host = 0; host < newest; ++host) {
    const PairGeometry& pair = pairs.at(host, newest);
    const bool current = options.current_reference;
    const Eigen::Matrix3f KRKi =
        current ? pair.KRKi : Eigen::Matrix3f(K * pair.R_first * K.inverse());
    const Eigen::Vector3f Kt = current ? pair.Kt : Eigen::Vector3f(K * pair.t_first);
    for (const WindowPoint& point : window.keyframes[host].points) {
      const bool seen = std::any_of(point.begin(), point.end(), [&](const Observation& o) {
        return o.target == newest && o.state == ResidualState::kIn;
      });
      const auto sample = seen ? sampleOf(point, KRKi, Kt) : std::nullopt;
      if (sample) samples.push_back(*sample);
    }
  }
  return samples;
}

}  // namespace dsorb::window
