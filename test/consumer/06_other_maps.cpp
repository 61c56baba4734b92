// SPDX-License-Identifier: BSD-3-Clause
// The same start for two other kinds of systems: map points with observations (as feature-based
// systems keep), and depth filters (as semi-direct ones do). docs/integrate.md explains it.
#include "images.h"

#include <dsorb/init/initializer.h>
#include <dsorb/init/map_start.h>

#include <cstdio>
#include <list>
#include <map>
#include <utility>
#include <vector>

namespace {

// [features]
struct Landmark {
  Eigen::Vector3d position;
  int host;
  Eigen::Vector2d pixel;                    // in the host, where its descriptor is computed
  std::map<int, Eigen::Vector2d> observed;  // keyframe -> pixel
};
struct FeatureMap {
  int addKeyframe(const dsorb::PosedFrame&) { return keyframes++; }
  Landmark* addPoint(int host,
                     const Eigen::Vector2d& pixel,
                     const Eigen::Vector3d& position,
                     const Eigen::Matrix3d&) {
    landmarks.push_back({position, host, pixel, {}});
    return &landmarks.back();
  }
  void observe(Landmark* point, int keyframe, const Eigen::Vector2d& pixel) {
    point->observed[keyframe] = pixel;
  }
  std::list<Landmark> landmarks;
  int keyframes = 0;
};
// [/features]

// [filters]
struct FilterMap {
  int addKeyframe(const dsorb::PosedFrame&) { return keyframes++; }
  void addFilter(
      int, const Eigen::Vector2d&, double mean, double variance, double, double, bool sure) {
    (sure ? points : waiting).emplace_back(mean, variance);
  }
  std::vector<std::pair<double, double>> points, waiting;
  int keyframes = 0;
};
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

    FeatureMap features;
    FilterMap filters;
    dsorb::startFeatures(features, *step.result, camera);
    dsorb::startFilters(filters, *step.result);
    std::size_t twice = 0, in_place = 0;
    for (const Landmark& landmark : features.landmarks) {
      twice += landmark.observed.size() >= 2 ? 1U : 0U;
      const auto in_host = landmark.observed.find(landmark.host);
      const bool there = in_host != landmark.observed.end();
      in_place += there && (in_host->second - landmark.pixel).norm() < 1e-3 ? 1U : 0U;
    }
    const std::size_t all = step.result->points.size();
    std::printf(
        "%zu landmarks, %zu seen twice, %zu where their host has them; %zu filters have "
        "converged\n",
        features.landmarks.size(),
        twice,
        in_place,
        filters.points.size());
    const bool complete = in_place == all && filters.points.size() + filters.waiting.size() == all;
    return complete && 10 * twice > 9 * all && 2 * filters.points.size() > all &&
                   filters.keyframes == 1
               ? 0
               : 1;
  }
  return std::puts("not initialized"), 1;
}
