// SPDX-License-Identifier: BSD-3-Clause
#include "odometry/initial_map.h"

#include "image/interpolate.h"

#include <cmath>
#include <optional>
#include <utility>

namespace dsorb::odometry {
namespace {

constexpr double kMinDepthRatio = 1e-3;  // new depth over the depth in the host; nearer is dropped

/// @source inverse depth of q = R ray + rho t is rho / q_z; its derivative by rho is
///         (R ray)_z / q_z^2
std::optional<DepthSample> moveTo(const SE3& T_target_host,
                                  const InitPoint& point,
                                  const PinholeCamera& camera) {
  const double rho = static_cast<double>(point.inverse_depth);
  const Eigen::Vector3d rotated =
      T_target_host.unitQuaternion() * camera.unproject(point.pixel.cast<double>());
  const Eigen::Vector3d q = rotated + rho * T_target_host.translation();
  if (!(q.z() > kMinDepthRatio) || !(rotated.z() > 0)) return std::nullopt;
  const double sigma =
      std::sqrt(static_cast<double>(point.variance)) * rotated.z() / (q.z() * q.z());
  DepthSample sample;
  sample.pixel = camera.project(q).cast<float>();
  sample.inverse_depth = static_cast<float>(rho / q.z());
  sample.weight = static_cast<float>(1.0 / sigma);
  return sample;
}

}  // namespace

std::vector<DepthSample> depthSamples(const InitializationResult& result,
                                      const PinholeCamera& camera,
                                      std::size_t target) {
  const SE3& T_target_ref = result.frames.at(target).T_cam_ref.value();
  std::vector<SE3> T_target_host;
  for (const PosedFrame& frame : result.frames) {
    T_target_host.push_back(frame.T_cam_ref ? T_target_ref * frame.T_cam_ref->inverse() : SE3());
  }
  std::vector<DepthSample> samples;
  samples.reserve(result.points.size());
  for (const InitPoint& point : result.points) {
    const auto host = static_cast<std::size_t>(point.host);
    if (const auto sample = moveTo(T_target_host.at(host), point, camera)) {
      samples.push_back(*sample);
    }
  }
  return samples;
}

std::vector<KeyframeSnapshot> initialKeyframes(const InitializationResult& result,
                                               const PinholeCamera& camera,
                                               int segment) {
  std::vector<std::vector<MapPoint>> hosted(result.frames.size());
  for (const InitPoint& point : result.points) {
    const auto host = static_cast<std::size_t>(point.host);
    const PyramidLevel& image = result.frames.at(host).frame->level(0);
    hosted[host].push_back({point.pixel,
                            point.inverse_depth,
                            point.variance,
                            interpolateIntensity(image, point.pixel.x(), point.pixel.y())});
  }
  std::vector<KeyframeSnapshot> keyframes;
  for (std::size_t i = 0; i < result.frames.size(); ++i) {
    const bool is_end = i == 0 || i + 1 == result.frames.size();
    if (hosted[i].empty() && !is_end) continue;
    const PosedFrame& frame = result.frames[i];
    keyframes.push_back({frame.frame->id(),
                         frame.frame->timestamp(),
                         segment,
                         frame.T_cam_ref.value().inverse(),
                         frame.affine,
                         camera,
                         std::move(hosted[i])});
  }
  return keyframes;
}

}  // namespace dsorb::odometry
