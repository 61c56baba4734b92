// SPDX-License-Identifier: BSD-3-Clause
// The same start for two other kinds of systems: map points with observations (as feature-based
// systems keep), and depth filters (as semi-direct ones do). docs/integrate.md explains it.
#include "images.h"

#include <Eigen/Dense>
#include <dsorb/init/initializer.h>

#include <cstdio>
#include <map>
#include <vector>

namespace {

// [features]
struct Landmark {
  Eigen::Vector3d position;    // in the reference camera
  Eigen::Matrix3d covariance;  // along the ray of its host; the ray itself counts as exact
  std::map<std::size_t, Eigen::Vector2d> observed;  // keyframe -> pixel
};

/// Landmarks with the pixels at which the posed frames see them. What the initializer measured is
/// inside poses and depths already, so these pixels are projections: refine or match them with your
/// own descriptors before an adjustment takes them for measurements.
std::vector<Landmark> landmarksOf(const dsorb::InitializationResult& result,
                                  const dsorb::PinholeCamera& camera) {
  std::vector<Landmark> landmarks;
  for (const dsorb::InitPoint& point : result.points) {
    const dsorb::SE3 T_ref_host =
        result.frames[static_cast<std::size_t>(point.host)].T_cam_ref->inverse();
    const Eigen::Vector3d ray = camera.unproject(point.pixel.cast<double>());
    const double rho = point.inverse_depth;
    const Eigen::Vector3d along =
        T_ref_host.rotationMatrix() * ray / (rho * rho);  // d position / d rho
    Landmark landmark{T_ref_host * (ray / rho), point.variance * along * along.transpose(), {}};
    for (std::size_t k = 0; k < result.frames.size(); ++k) {
      if (!result.frames[k].T_cam_ref) continue;
      const Eigen::Vector3d p = *result.frames[k].T_cam_ref * landmark.position;
      if (p.z() > 0 && camera.contains(camera.project(p), 2))
        landmark.observed[k] = camera.project(p);
    }
    landmarks.push_back(landmark);
  }
  return landmarks;
}
// [/features]

// [filters]
/// Depth filter of a pixel: inverse depth as a Gaussian, share of good measurements as a Beta
/// distribution.
struct DepthFilter {
  std::size_t keyframe;
  Eigen::Vector2d pixel;
  double mean;
  double variance;
  double good, bad;  // of the Beta distribution
};

/// A start's variance contains what was measured in all its frames, so a filter continues from it:
/// each observation counts as a good measurement. Do not feed the start's frames again.
std::vector<DepthFilter> filtersOf(const dsorb::InitializationResult& result) {
  std::vector<DepthFilter> filters;
  for (const dsorb::InitPoint& p : result.points) {
    filters.push_back({static_cast<std::size_t>(p.host),
                       p.pixel.cast<double>(),
                       p.inverse_depth,
                       p.variance,
                       10.0 + p.observations,
                       10.0});
  }
  return filters;
}

/// A filter this sure is a point of the map.
bool hasConverged(const DepthFilter& filter) {
  return std::sqrt(filter.variance) < 0.1 * filter.mean;
}
// [/filters]

}  // namespace

int main() {
  const dsorb::PinholeCamera camera{kFocal, kFocal, kWidth / 2.0, kHeight / 2.0, kWidth, kHeight};
  const auto initializer = dsorb::makeInitializer(dsorb::InitializerOptions(), camera);
  for (int i = 0; i < 30; ++i) {
    const auto pixels = grabImage(i);
    const auto step = initializer->addFrame(dsorb::Frame::create(
        dsorb::ImageView(pixels.data(), kWidth, kHeight), {dsorb::FrameId{i}, i / 30.0}));
    if (!step.result) continue;
    const dsorb::InitializationResult& result = *step.result;

    std::size_t twice = 0, in_place = 0;
    const std::vector<Landmark> landmarks = landmarksOf(result, camera);
    for (std::size_t k = 0; k < landmarks.size(); ++k) {
      const dsorb::InitPoint& point = result.points[k];
      const auto& observed = landmarks[k].observed;
      if (observed.size() >= 2) ++twice;
      const auto in_host = observed.find(static_cast<std::size_t>(point.host));
      if (in_host != observed.end() && (in_host->second - point.pixel.cast<double>()).norm() < 1e-3)
        ++in_place;
    }
    std::size_t converged = 0;
    for (const DepthFilter& filter : filtersOf(result)) converged += hasConverged(filter) ? 1U : 0U;
    std::printf(
        "%zu landmarks, %zu seen twice, %zu where their host has them; %zu filters have "
        "converged\n",
        landmarks.size(),
        twice,
        in_place,
        converged);
    return in_place == landmarks.size() && 10 * twice > 9 * landmarks.size() &&
                   2 * converged > landmarks.size()
               ? 0
               : 1;
  }
  return std::puts("not initialized"), 1;
}
