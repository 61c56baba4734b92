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

/// Squared gradients of the rows of levels 1 and 2 that show a row of the image.
class CoarseGradients {
 public:
  explicit CoarseGradients(const Frame& frame) : frame_(frame) {
    rows_.resize(static_cast<std::size_t>(std::min(frame.pyramid().levels(), kLevels) - 1));
    for (int level = 1; has(level); ++level) {
      row(level).squared.resize(static_cast<std::size_t>(frame.level(level).width()));
    }
  }
  void moveTo(int y) {
    for (int level = 1; has(level); ++level) {
      Row& kept = row(level);
      if (kept.y == y >> level) continue;
      kept.y = y >> level;
      squareGradients(frame_.level(level), kept.y, frame_.responseSlope(), kept.squared.data());
    }
  }
  [[nodiscard]] bool has(int level) const {
    return static_cast<std::size_t>(level) <= rows_.size();
  }
  [[nodiscard]] const float* at(int level) const {
    return rows_[static_cast<std::size_t>(level) - 1].squared.data();
  }

 private:
  static constexpr int kLevels = 3;  // of the pyramid that make scales
  struct Row {
    int y = -1;
    std::vector<float> squared;
  };
  Row& row(int level) { return rows_[static_cast<std::size_t>(level) - 1]; }

  const Frame& frame_;
  std::vector<Row> rows_;
};

/// Adds the scale of a level. Its pixels end where runs do: sides of a frame that has the level,
/// and of regions, are multiples of the scale.
template <int kLevel>
void addLevel(const float* squared, const Run& run, float threshold, std::uint8_t* scales) {
  constexpr int kScale = 1 << kLevel;
  for (int x = run.begin; x < run.end; x += kScale) {
    if (!(squared[x >> kLevel] > threshold)) continue;
    for (int i = 0; i < kScale; ++i) {
      scales[x + i] = static_cast<std::uint8_t>(scales[x + i] + kScale);
    }
  }
}

void fillRow(const RegionThresholds& thresholds,
             const CoarseGradients& coarse,
             float factor,
             const Run& row,
             std::uint8_t* scales) {
  constexpr int kSide = RegionThresholds::kRegionSize;
  const float* squared = thresholds.squaredGradients(row.y);
  for (int begin = row.begin; begin < row.end; begin += kSide) {
    const Run run{row.y, begin, std::min(begin + kSide, row.end)};
    const float threshold = factor * thresholds.squaredThreshold(begin, row.y);
    for (int x = run.begin; x < run.end; ++x) scales[x] = squared[x] > threshold ? 1 : 0;
    if (coarse.has(1)) addLevel<1>(coarse.at(1), run, kScaleFactor1 * threshold, scales);
    if (coarse.has(2)) addLevel<2>(coarse.at(2), run, kScaleFactor2 * threshold, scales);
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
    CoarseGradients coarse(frame);
    for (auto y = static_cast<int>(begin); y < static_cast<int>(end); ++y) {
      coarse.moveTo(y);
      fillRow(thresholds,
              coarse,
              threshold_factor,
              {y, 0, width_},
              scales_.data() + static_cast<std::ptrdiff_t>(y) * width_);
    }
  });
}

}  // namespace dsorb
