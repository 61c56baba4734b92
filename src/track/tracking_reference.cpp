// SPDX-License-Identifier: BSD-3-Clause
#include "track/tracking_reference.h"

#include "base/parallel.h"
#include "estimate/sampling.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <tuple>

namespace dsorb::track {
namespace {

constexpr int kBorder = 2;             // [px]; pixels of a level nearer to its edge carry no point
constexpr std::size_t kRowGrain = 32;  // rows one thread takes at a time
constexpr std::size_t kDilated = 5;    // points that dilation makes of a sample at most

int nearest(float coordinate) {
  return static_cast<int>(std::floor(coordinate + 0.5F));
}

bool isUsable(const DepthSample& sample, const PyramidLevel& level) {
  const float x = sample.pixel.x();
  const float y = sample.pixel.y();
  return x >= kBorder && y >= kBorder && x < static_cast<float>(level.width() - kBorder - 1) &&
         y < static_cast<float>(level.height() - kBorder - 1) && sample.inverse_depth > 0 &&
         std::isfinite(sample.inverse_depth) && sample.weight > 0 && std::isfinite(sample.weight);
}

/// Turns the rays of a level into those of a pinhole camera at the time of the middle row.
void moveToMiddle(int level, TrackingReference& reference) {
  const auto shutter = shutterOf(*reference.frame, reference.motion, reference.change, level);
  if (!shutter) return;
  const PinholeCamera camera = reference.camera.atLevel(level);
  ReferencePoints& points = reference.points[static_cast<std::size_t>(level)];
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector2d seen = camera.project(
        {static_cast<double>(points.ray_x[i]), static_cast<double>(points.ray_y[i]), 1});
    const Eigen::Vector2f pixel =
        pixelInMiddle(*shutter, camera, seen.cast<float>(), points.inverse_depth[i]);
    const Eigen::Vector3f ray = camera.unproject(pixel.cast<double>()).cast<float>();
    points.ray_x[i] = ray.x();
    points.ray_y[i] = ray.y();
  }
}

using Offsets = std::array<PatternOffset, 4>;
constexpr Offsets kDiagonal = {{{-1, -1}, {1, -1}, {-1, 1}, {1, 1}}};
constexpr Offsets kDirect = {{{0, -1}, {-1, 0}, {1, 0}, {0, 1}}};

/// Gives an empty pixel the means of its neighbours, negative, which are not seen as depths.
void fillFrom(const Offsets& neighbours, int x, int y, DepthAccumulator& level) {
  float depth_sum = 0;
  float weight_sum = 0;
  int count = 0;
  for (const PatternOffset& offset : neighbours) {
    const std::size_t there = level.index(x + offset.x, y + offset.y);
    if (level.weight[there] <= 0) continue;
    depth_sum += level.weighted_depth[there];
    weight_sum += level.weight[there];
    ++count;
  }
  level.weighted_depth[level.index(x, y)] = -depth_sum / static_cast<float>(count);
  level.weight[level.index(x, y)] = -weight_sum / static_cast<float>(count);
}

}  // namespace

void ReferencePoints::reserve(std::size_t points) {
  for (std::vector<float>* values : {&ray_x, &ray_y, &inverse_depth, &intensity}) {
    values->reserve(points);
  }
}

void ReferencePoints::append(float x, float y, float depth, float grey) {
  ray_x.push_back(x);
  ray_y.push_back(y);
  inverse_depth.push_back(depth);
  intensity.push_back(grey);
}

void DepthAccumulator::reset(int new_width, int new_height) {
  width = new_width;
  height = new_height;
  const std::size_t size = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  weighted_depth.assign(size, 0.0F);
  weight.assign(size, 0.0F);
}

void accumulateBlocks(const DepthAccumulator& fine, DepthAccumulator& coarse) {
  coarse.reset(fine.width / 2, fine.height / 2);
  const auto sum_below = [&](const std::vector<float>& values, int x, int y) {
    const float* upper = &values[fine.index(2 * x, 2 * y)];
    const float* lower = upper + fine.width;
    return (upper[0] + upper[1]) + (lower[0] + lower[1]);
  };
  forEachRange(
      static_cast<std::size_t>(coarse.height), kRowGrain, [&](std::size_t begin, std::size_t end) {
        for (auto y = static_cast<int>(begin); y < static_cast<int>(end); ++y) {
          for (int x = 0; x < coarse.width; ++x) {
            const std::size_t to = coarse.index(x, y);
            coarse.weighted_depth[to] = sum_below(fine.weighted_depth, x, y);
            coarse.weight[to] = sum_below(fine.weight, x, y);
          }
        }
      });
}

void dilate(DepthAccumulator& level, DilationNeighbours neighbours) {
  const Offsets& offsets = neighbours == DilationNeighbours::kDiagonal ? kDiagonal : kDirect;
  for (int y = 1; y < level.height - 1; ++y) {
    for (int x = 1; x < level.width - 1; ++x) {
      if (level.weight[level.index(x, y)] <= 0) continue;  // few pixels have a depth
      for (const PatternOffset& offset : offsets) {
        const int to_x = x + offset.x;
        const int to_y = y + offset.y;
        const bool inside =
            to_x > 0 && to_y > 0 && to_x < level.width - 1 && to_y < level.height - 1;
        if (inside && level.weight[level.index(to_x, to_y)] == 0) {
          fillFrom(offsets, to_x, to_y, level);
        }
      }
    }
  }
}

TrackingReferenceBuilder::TrackingReferenceBuilder(const PinholeCamera& camera)
    : maps_(static_cast<std::size_t>(pyramidLevels(camera.width, camera.height))) {
  for (std::size_t l = 0; l < maps_.size(); ++l) {
    maps_[l].reset(camera.width >> l, camera.height >> l);
  }
}

void TrackingReferenceBuilder::fill(const std::vector<DepthSample>& samples,
                                    TrackingReference& reference) {
  DepthAccumulator& finest = maps_[0];
  finest.reset(finest.width, finest.height);
  keepUsable(samples, reference.frame->level(0));
  for (const DepthSample& sample : usable_) {
    const std::size_t to = finest.index(nearest(sample.pixel.x()), nearest(sample.pixel.y()));
    finest.weighted_depth[to] += sample.weight * sample.inverse_depth;
    finest.weight[to] += sample.weight;
  }
  for (std::size_t l = 1; l < maps_.size(); ++l) accumulateBlocks(maps_[l - 1], maps_[l]);
  const int levels = reference.frame->pyramid().levels();
  reference.points.assign(static_cast<std::size_t>(levels), {});
  for (std::size_t l = 0; l < reference.points.size(); ++l) {
    reference.points[l].reserve(std::min(kDilated * usable_.size(), maps_[l].weight.size()));
  }
  runBoth([&] { list(0, reference); },
          [&] {
            for (int l = 1; l < levels; ++l) list(l, reference);
          });
  for (int l = 0; l < levels; ++l) moveToMiddle(l, reference);
}

/// Row by row, so that neighbours in the list are neighbours in the image, whatever their order
/// was.
void TrackingReferenceBuilder::keepUsable(const std::vector<DepthSample>& samples,
                                          const PyramidLevel& level) {
  usable_.clear();
  std::copy_if(samples.begin(),
               samples.end(),
               std::back_inserter(usable_),
               [&level](const DepthSample& sample) { return isUsable(sample, level); });
  const auto place = [](const DepthSample& sample) {
    const Eigen::Vector2f& pixel = sample.pixel;
    return std::make_tuple(nearest(pixel.y()), pixel.x(), pixel.y(), sample.inverse_depth);
  };
  std::sort(usable_.begin(), usable_.end(), [&place](const DepthSample& l, const DepthSample& r) {
    return place(l) < place(r);
  });
}

/// Points of one level: on the finest the samples themselves, then pixels row by row.
void TrackingReferenceBuilder::list(int index, TrackingReference& reference) {
  const PyramidLevel& level = reference.frame->level(index);
  const PinholeCamera camera = reference.camera.atLevel(index);
  const auto inverse_fx = static_cast<float>(1.0 / camera.fx);
  const auto inverse_fy = static_cast<float>(1.0 / camera.fy);
  const auto cx = static_cast<float>(camera.cx);
  const auto cy = static_cast<float>(camera.cy);
  ReferencePoints& points = reference.points[static_cast<std::size_t>(index)];
  const auto add = [&](float x, float y, float inverse_depth, float intensity) {
    if (!std::isfinite(intensity)) return;
    points.append((x - cx) * inverse_fx, (y - cy) * inverse_fy, inverse_depth, intensity);
  };
  const bool exact = index == 0;
  if (exact) {
    for (const DepthSample& sample : usable_) {
      const float x = sample.pixel.x();
      const float y = sample.pixel.y();
      add(x, y, sample.inverse_depth, interpolateIntensity(level, x, y));
    }
  }
  DepthAccumulator& map = maps_[static_cast<std::size_t>(index)];
  dilate(map, index < 2 ? DilationNeighbours::kDiagonal : DilationNeighbours::kDirect);
  for (int y = kBorder; y < level.height() - kBorder; ++y) {
    for (int x = kBorder; x < level.width() - kBorder; ++x) {
      const std::size_t here = map.index(x, y);
      const float weight = map.weight[here];
      if (weight == 0 || (exact && weight > 0)) continue;
      add(static_cast<float>(x),
          static_cast<float>(y),
          map.weighted_depth[here] / weight,
          level.intensity(x, y));
    }
  }
}

}  // namespace dsorb::track
