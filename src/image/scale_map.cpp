// SPDX-License-Identifier: BSD-3-Clause
#include "image/scale_map.h"

#include "base/parallel.h"

#include <algorithm>

namespace dsorb {
namespace {

constexpr std::size_t kRowGrain = 32;  // rows one thread takes at a time

constexpr float kScaleFactor1 = 0.75F;      // threshold factor of level 1; DSO as published
constexpr float kScaleFactor2 = 0.421875F;  // of level 2: 0.75 cubed; DSO as published

/// Pixels of a row that belong to one region.
struct Run {
  int y;
  int begin;
  int end;
};

/// Adds the scale of a level. Its pixels end where runs do: sides of a frame that has the level,
/// and of regions, are multiples of the scale.
template <int kLevel>
void addLevel(const Frame& frame, const Run& run, float threshold, std::uint8_t* scales) {
  constexpr int kScale = 1 << kLevel;
  const ImageSample* samples = frame.level(kLevel).row(run.y >> kLevel);
  const ResponseSlope* slope = frame.responseSlope();
  for (int x = run.begin; x < run.end; x += kScale) {
    const ImageSample& sample = samples[x >> kLevel];
    const float squared = slope == nullptr ? sample.dx * sample.dx + sample.dy * sample.dy
                                           : rawSquaredGradient(sample, slope);
    if (!(squared > threshold)) continue;
    for (int i = 0; i < kScale; ++i) {
      scales[x + i] = static_cast<std::uint8_t>(scales[x + i] + kScale);
    }
  }
}

void fillRow(const Frame& frame,
             const RegionThresholds& thresholds,
             float factor,
             int y,
             std::uint8_t* scales) {
  constexpr int kSide = RegionThresholds::kRegionSize;
  const float* squared = thresholds.squaredGradients(y);
  const int levels = frame.pyramid().levels();
  for (int begin = 0; begin < frame.width(); begin += kSide) {
    const Run run{y, begin, std::min(begin + kSide, frame.width())};
    const float threshold = factor * thresholds.squaredThreshold(begin, y);
    for (int x = run.begin; x < run.end; ++x) scales[x] = squared[x] > threshold ? 1 : 0;
    if (levels > 1) addLevel<1>(frame, run, kScaleFactor1 * threshold, scales);
    if (levels > 2) addLevel<2>(frame, run, kScaleFactor2 * threshold, scales);
  }
}

}  // namespace

void ScaleMap::resize(int width, int height) {
  width_ = width;
  scales_.resize(static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
}

void ScaleMap::compute(const Frame& frame,
                       const RegionThresholds& thresholds,
                       float threshold_factor) {
  resize(frame.width(), frame.height());
  const auto height = static_cast<std::size_t>(frame.height());
  forEachRange(height, kRowGrain, [&](std::size_t begin, std::size_t end) {
    for (auto y = static_cast<std::ptrdiff_t>(begin); y < static_cast<std::ptrdiff_t>(end); ++y) {
      fillRow(
          frame, thresholds, threshold_factor, static_cast<int>(y), scales_.data() + y * width_);
    }
  });
}

}  // namespace dsorb
