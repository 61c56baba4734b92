// SPDX-License-Identifier: BSD-3-Clause
#include "track/tracking_reference.h"

#include "base/parallel.h"
#include "estimate/rolling_shutter.h"
#include "estimate/sampling.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace dsorb::track {
namespace {

constexpr int kBorder = 2;             // [px]; pixels of a level nearer to its edge carry no point
constexpr std::size_t kRowGrain = 32;  // rows one thread takes at a time

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

/// Appends pixel coordinates of one level as rays.
class PointAppender {
 public:
  PointAppender(const PinholeCamera& level_camera, ReferencePoints& points)
      : points_(points),
        inverse_fx_(static_cast<float>(1.0 / level_camera.fx)),
        inverse_fy_(static_cast<float>(1.0 / level_camera.fy)),
        cx_(static_cast<float>(level_camera.cx)),
        cy_(static_cast<float>(level_camera.cy)) {}

  void operator()(float x, float y, float inverse_depth, float intensity) {
    if (!std::isfinite(intensity)) return;
    points_.append((x - cx_) * inverse_fx_, (y - cy_) * inverse_fy_, inverse_depth, intensity);
  }

 private:
  ReferencePoints& points_;
  float inverse_fx_;
  float inverse_fy_;
  float cx_;
  float cy_;
};

}  // namespace

void ReferencePoints::clear() {
  ray_x.clear();
  ray_y.clear();
  inverse_depth.clear();
  intensity.clear();
}

void ReferencePoints::append(float x, float y, float depth, float grey) {
  ray_x.push_back(x);
  ray_y.push_back(y);
  inverse_depth.push_back(depth);
  intensity.push_back(grey);
}

void DepthAccumulator::resize(int new_width, int new_height) {
  width = new_width;
  height = new_height;
  const std::size_t size = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  weighted_depth.resize(size);
  weight.resize(size);
}

void DepthAccumulator::reset(int new_width, int new_height) {
  resize(new_width, new_height);
  std::fill(weighted_depth.begin(), weighted_depth.end(), 0.0F);
  std::fill(weight.begin(), weight.end(), 0.0F);
}

void accumulateBlocks(const DepthAccumulator& fine, DepthAccumulator& coarse) {
  coarse.resize(fine.width / 2, fine.height / 2);
  const auto add = [&](const std::vector<float>& from, std::vector<float>& to, int y) {
    const float* upper = &from[fine.index(0, 2 * y)];
    const float* lower = &from[fine.index(0, 2 * y + 1)];
    float* sums = &to[coarse.index(0, y)];
    for (std::ptrdiff_t x = 0; x < coarse.width; ++x) {
      sums[x] = (upper[2 * x] + upper[2 * x + 1]) + (lower[2 * x] + lower[2 * x + 1]);
    }
  };
  forEachRange(
      static_cast<std::size_t>(coarse.height), kRowGrain, [&](std::size_t begin, std::size_t end) {
        for (auto y = static_cast<int>(begin); y < static_cast<int>(end); ++y) {
          add(fine.weighted_depth, coarse.weighted_depth, y);
          add(fine.weight, coarse.weight, y);
        }
      });
}

void dilate(DepthAccumulator& level, DilationNeighbours neighbours) {
  constexpr std::array<PatternOffset, 4> kDiagonal = {{{-1, -1}, {1, -1}, {-1, 1}, {1, 1}}};
  constexpr std::array<PatternOffset, 4> kDirect = {{{0, -1}, {-1, 0}, {1, 0}, {0, 1}}};
  const auto& offsets = neighbours == DilationNeighbours::kDiagonal ? kDiagonal : kDirect;
  const auto fill = [&](int x, int y) {
    float depth_sum = 0;
    float weight_sum = 0;
    int count = 0;
    for (const PatternOffset& offset : offsets) {
      const std::size_t there = level.index(x + offset.x, y + offset.y);
      if (level.weight[there] <= 0) continue;
      depth_sum += level.weighted_depth[there];
      weight_sum += level.weight[there];
      ++count;
    }
    level.weighted_depth[level.index(x, y)] = -depth_sum / static_cast<float>(count);
    level.weight[level.index(x, y)] = -weight_sum / static_cast<float>(count);
  };
  // Few pixels have a depth: start from them. Negative values are not seen as depths.
  for (int y = 0; y < level.height; ++y) {
    for (int x = 0; x < level.width; ++x) {
      if (!(level.weight[level.index(x, y)] > 0)) continue;
      for (const PatternOffset& offset : offsets) {
        const int to_x = x + offset.x;
        const int to_y = y + offset.y;
        const bool inside =
            to_x > 0 && to_y > 0 && to_x < level.width - 1 && to_y < level.height - 1;
        if (inside && level.weight[level.index(to_x, to_y)] == 0) fill(to_x, to_y);
      }
    }
  }
}

TrackingReference::TrackingReference(const PinholeCamera& camera)
    : camera_(camera), maps_(static_cast<std::size_t>(pyramidLevels(camera.width, camera.height))) {
  for (std::size_t l = 0; l < maps_.size(); ++l) {
    maps_[l].resize(camera.width >> l, camera.height >> l);
  }
}

void TrackingReference::set(const FramePtr& frame,
                            const std::vector<DepthSample>& samples,
                            const AffineBrightness& affine,
                            const RowMotion& motion,
                            double readout_change) {
  frame_ = frame;
  motion_ = motion;
  readout_change_ = readout_change;
  affine_ = affine;
  const auto levels = static_cast<std::size_t>(frame->pyramid().levels());
  points_.resize(levels);
  maps_.resize(levels);
  sortIntoRows(samples);
  maps_[0].reset(frame->width(), frame->height());
  for (const DepthSample& sample : sorted_) {
    const std::size_t to = maps_[0].index(nearest(sample.pixel.x()), nearest(sample.pixel.y()));
    maps_[0].weighted_depth[to] += sample.weight * sample.inverse_depth;
    maps_[0].weight[to] += sample.weight;
  }
  for (std::size_t l = 1; l < levels; ++l) accumulateBlocks(maps_[l - 1], maps_[l]);
  runBoth([&] { listFinest(); },
          [&] {
            for (std::size_t l = 1; l < levels; ++l) listCoarse(static_cast<int>(l));
          });
  if (!isRolling(*frame)) return;
  for (std::size_t l = 0; l < levels; ++l) moveToMiddle(static_cast<int>(l));
}

void TrackingReference::moveToMiddle(int level) {
  const PinholeCamera camera = camera_.atLevel(level);
  const RollingShutter shutter =
      makeRollingShutter(rowTimesOf(*frame_, readout_change_), motion_, level);
  ReferencePoints& points = points_[static_cast<std::size_t>(level)];
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector2d seen = camera.project(
        {static_cast<double>(points.ray_x[i]), static_cast<double>(points.ray_y[i]), 1});
    const Eigen::Vector2f pixel =
        pixelInMiddle(shutter, camera, seen.cast<float>(), points.inverse_depth[i]);
    const Eigen::Vector3f ray = camera.unproject(pixel.cast<double>()).cast<float>();
    points.ray_x[i] = ray.x();
    points.ray_y[i] = ray.y();
  }
}

void TrackingReference::sortIntoRows(const std::vector<DepthSample>& samples) {
  const PyramidLevel& level = frame_->level(0);
  sorted_.clear();
  for (const DepthSample& sample : samples) {
    if (isUsable(sample, level)) sorted_.push_back(sample);
  }
  std::sort(sorted_.begin(), sorted_.end(), [](const DepthSample& l, const DepthSample& r) {
    const int row_l = nearest(l.pixel.y());
    const int row_r = nearest(r.pixel.y());
    if (row_l != row_r) return row_l < row_r;
    if (l.pixel.x() != r.pixel.x()) return l.pixel.x() < r.pixel.x();
    if (l.pixel.y() != r.pixel.y()) return l.pixel.y() < r.pixel.y();
    return l.inverse_depth < r.inverse_depth;
  });
  row_begin_.assign(static_cast<std::size_t>(level.height()) + 1, 0);
  for (const DepthSample& sample : sorted_) {
    ++row_begin_[static_cast<std::size_t>(nearest(sample.pixel.y())) + 1];
  }
  for (std::size_t y = 1; y < row_begin_.size(); ++y) row_begin_[y] += row_begin_[y - 1];
}

/// Row by row, so that neighbours in the list are neighbours in the image: first the samples
/// themselves, then the pixels that only the dilation reaches.
void TrackingReference::listFinest() {
  const PyramidLevel& level = frame_->level(0);
  DepthAccumulator& map = maps_[0];
  points_[0].clear();
  PointAppender append(camera_, points_[0]);
  dilate(map, DilationNeighbours::kDiagonal);
  for (int y = kBorder; y < level.height() - kBorder; ++y) {
    const auto row = static_cast<std::size_t>(y);
    for (std::uint32_t i = row_begin_[row]; i < row_begin_[row + 1]; ++i) {
      const DepthSample& sample = sorted_[i];
      const float x = sample.pixel.x();
      const float exact_y = sample.pixel.y();
      append(x, exact_y, sample.inverse_depth, interpolateIntensity(level, x, exact_y));
    }
    for (int x = kBorder; x < level.width() - kBorder; ++x) {
      const std::size_t here = map.index(x, y);
      if (map.weight[here] >= 0) continue;
      append(static_cast<float>(x),
             static_cast<float>(y),
             map.weighted_depth[here] / map.weight[here],
             level.at(x, y).intensity);
    }
  }
}

void TrackingReference::listCoarse(int index) {
  const PyramidLevel& level = frame_->level(index);
  DepthAccumulator& map = maps_[static_cast<std::size_t>(index)];
  ReferencePoints& points = points_[static_cast<std::size_t>(index)];
  points.clear();
  PointAppender append(camera_.atLevel(index), points);
  dilate(map, index < 2 ? DilationNeighbours::kDiagonal : DilationNeighbours::kDirect);
  for (int y = kBorder; y < level.height() - kBorder; ++y) {
    for (int x = kBorder; x < level.width() - kBorder; ++x) {
      const std::size_t here = map.index(x, y);
      if (map.weight[here] == 0) continue;
      append(static_cast<float>(x),
             static_cast<float>(y),
             map.weighted_depth[here] / map.weight[here],
             level.at(x, y).intensity);
    }
  }
}

}  // namespace dsorb::track
