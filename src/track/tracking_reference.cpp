// SPDX-License-Identifier: BSD-3-Clause
#include "track/tracking_reference.h"

#include "base/parallel.h"
#include "estimate/sampling.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace dsorb::track {
namespace {

constexpr int kBorder = 2;             // [px]; pixels of a level nearer to its edge carry no point
constexpr std::size_t kRowGrain = 32;  // rows one thread takes at a time
constexpr std::size_t kDilated = 5;    // points that dilation makes of a sample at most
constexpr std::array<PatternOffset, 4> kDiagonal = {{{-1, -1}, {1, -1}, {-1, 1}, {1, 1}}};

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

/// Sum of the 2 x 2 block under a pixel of the coarser level.
void sumBlock(const DepthAccumulator& fine, DepthAccumulator& coarse, int x, int y) {
  const auto sum = [&](const std::vector<float>& values) {
    const float* upper = &values[fine.index(2 * x, 2 * y)];
    const float* lower = upper + fine.width;
    return (upper[0] + upper[1]) + (lower[0] + lower[1]);
  };
  const std::size_t to = coarse.index(x, y);
  coarse.weighted_depth[to] = sum(fine.weighted_depth);
  coarse.weight[to] = sum(fine.weight);
}

/// Few pixels have a depth: it starts from them. Negative values are not seen as depths.
class Dilation {
 public:
  Dilation(DepthAccumulator& level, DilationNeighbours neighbours)
      : level_(level),
        offsets_(neighbours == DilationNeighbours::kDiagonal ? kDiagonal : kDirect) {}

  /// Fills the empty neighbours of a pixel with weight.
  void from(int x, int y) const {
    for (const PatternOffset& offset : offsets_) {
      const int to_x = x + offset.x;
      const int to_y = y + offset.y;
      const bool inside =
          to_x > 0 && to_y > 0 && to_x < level_.width - 1 && to_y < level_.height - 1;
      if (inside && level_.weight[level_.index(to_x, to_y)] == 0) fill(to_x, to_y);
    }
  }

 private:
  using Offsets = std::array<PatternOffset, 4>;
  static constexpr Offsets kDirect = {{{0, -1}, {-1, 0}, {1, 0}, {0, 1}}};

  void fill(int x, int y) const {
    float depth_sum = 0;
    float weight_sum = 0;
    int count = 0;
    for (const PatternOffset& offset : offsets_) {
      const std::size_t there = level_.index(x + offset.x, y + offset.y);
      if (level_.weight[there] <= 0) continue;
      depth_sum += level_.weighted_depth[there];
      weight_sum += level_.weight[there];
      ++count;
    }
    level_.weighted_depth[level_.index(x, y)] = -depth_sum / static_cast<float>(count);
    level_.weight[level_.index(x, y)] = -weight_sum / static_cast<float>(count);
  }

  DepthAccumulator& level_;
  const Offsets& offsets_;
};

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
  forEachRange(
      static_cast<std::size_t>(coarse.height), kRowGrain, [&](std::size_t begin, std::size_t end) {
        for (auto y = static_cast<int>(begin); y < static_cast<int>(end); ++y) {
          for (int x = 0; x < coarse.width; ++x) sumBlock(fine, coarse, x, y);
        }
      });
}

void dilate(DepthAccumulator& level, DilationNeighbours neighbours) {
  const Dilation dilation(level, neighbours);
  for (int y = 0; y < level.height; ++y) {
    for (int x = 0; x < level.width; ++x) {
      if (level.weight[level.index(x, y)] > 0) dilation.from(x, y);
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
  clearFinest();
  sortIntoRows(samples, reference.frame->level(0));
  accumulate();
  const int levels = reference.frame->pyramid().levels();
  reference.points.assign(static_cast<std::size_t>(levels), {});
  for (std::size_t l = 0; l < reference.points.size(); ++l) {
    reference.points[l].reserve(std::min(kDilated * sorted_.size(), maps_[l].weight.size()));
  }
  runBoth([&] { listFinest(reference); },
          [&] {
            for (int l = 1; l < levels; ++l) listCoarse(l, reference);
          });
  for (int l = 0; l < levels; ++l) moveToMiddle(l, reference);
}

/// Sets what the samples before have touched back to 0: nearly all of the level is.
void TrackingReferenceBuilder::clearFinest() {
  DepthAccumulator& map = maps_[0];
  const auto clear = [&](int x, int y) {
    map.weighted_depth[map.index(x, y)] = map.weight[map.index(x, y)] = 0;
  };
  for (const DepthSample& sample : sorted_) {
    const int x = nearest(sample.pixel.x());
    const int y = nearest(sample.pixel.y());
    clear(x, y);
    for (const PatternOffset& offset : kDiagonal) clear(x + offset.x, y + offset.y);
  }
}

/// Fills the maps of all levels, those of the first two only where there are samples.
void TrackingReferenceBuilder::accumulate() {
  DepthAccumulator& finest = maps_[0];
  for (const DepthSample& sample : sorted_) {
    const std::size_t to = finest.index(nearest(sample.pixel.x()), nearest(sample.pixel.y()));
    finest.weighted_depth[to] += sample.weight * sample.inverse_depth;
    finest.weight[to] += sample.weight;
  }
  if (maps_.size() < 2) return;
  maps_[1].reset(finest.width / 2, finest.height / 2);
  for (const DepthSample& sample : sorted_) {
    sumBlock(finest, maps_[1], nearest(sample.pixel.x()) / 2, nearest(sample.pixel.y()) / 2);
  }
  for (std::size_t l = 2; l < maps_.size(); ++l) accumulateBlocks(maps_[l - 1], maps_[l]);
}

void TrackingReferenceBuilder::sortIntoRows(const std::vector<DepthSample>& samples,
                                            const PyramidLevel& level) {
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

/// Columns of a row of the finest level that only the dilation reaches, ascending.
void TrackingReferenceBuilder::findDilated(int y, std::vector<int>& columns) const {
  columns.clear();
  for (const int row : {y - 1, y + 1}) {
    const auto r = static_cast<std::size_t>(row);
    for (std::uint32_t i = row_begin_[r]; i < row_begin_[r + 1]; ++i) {
      const int middle = nearest(sorted_[i].pixel.x());
      for (const int x : {middle - 1, middle + 1}) {
        const bool inside = x >= kBorder && x < maps_[0].width - kBorder;
        if (inside && maps_[0].weight[maps_[0].index(x, y)] < 0) columns.push_back(x);
      }
    }
  }
  std::sort(columns.begin(), columns.end());
  columns.erase(std::unique(columns.begin(), columns.end()), columns.end());
}

/// Row by row, so that neighbours in the list are neighbours in the image: first the samples
/// themselves, then the pixels that only the dilation reaches.
void TrackingReferenceBuilder::listFinest(TrackingReference& reference) {
  const PyramidLevel& level = reference.frame->level(0);
  DepthAccumulator& map = maps_[0];
  PointAppender append(reference.camera, reference.points[0]);
  const Dilation dilation(map, DilationNeighbours::kDiagonal);
  for (const DepthSample& sample : sorted_) {
    dilation.from(nearest(sample.pixel.x()), nearest(sample.pixel.y()));
  }
  std::vector<int> dilated;
  for (int y = kBorder; y < level.height() - kBorder; ++y) {
    const auto row = static_cast<std::size_t>(y);
    for (std::uint32_t i = row_begin_[row]; i < row_begin_[row + 1]; ++i) {
      const DepthSample& sample = sorted_[i];
      const float x = sample.pixel.x();
      const float exact_y = sample.pixel.y();
      append(x, exact_y, sample.inverse_depth, interpolateIntensity(level, x, exact_y));
    }
    findDilated(y, dilated);
    for (const int x : dilated) {
      const std::size_t here = map.index(x, y);
      append(static_cast<float>(x),
             static_cast<float>(y),
             map.weighted_depth[here] / map.weight[here],
             level.intensity(x, y));
    }
  }
}

void TrackingReferenceBuilder::listCoarse(int index, TrackingReference& reference) {
  const PyramidLevel& level = reference.frame->level(index);
  DepthAccumulator& map = maps_[static_cast<std::size_t>(index)];
  PointAppender append(reference.camera.atLevel(index),
                       reference.points[static_cast<std::size_t>(index)]);
  dilate(map, index < 2 ? DilationNeighbours::kDiagonal : DilationNeighbours::kDirect);
  for (int y = kBorder; y < level.height() - kBorder; ++y) {
    for (int x = kBorder; x < level.width() - kBorder; ++x) {
      const std::size_t here = map.index(x, y);
      if (map.weight[here] == 0) continue;
      append(static_cast<float>(x),
             static_cast<float>(y),
             map.weighted_depth[here] / map.weight[here],
             level.intensity(x, y));
    }
  }
}

}  // namespace dsorb::track
