// SPDX-License-Identifier: BSD-3-Clause
#include "image/region_thresholds.h"

#include "base/parallel.h"

#include <array>
#include <cmath>

namespace dsorb {
namespace {

constexpr double kAboveMedian = 7;        // [grey levels / px]; DSO, section 3.2
constexpr int kGradientBins = 49;         // of 1 grey level / px; the last one takes the rest
constexpr std::size_t kRowGrain = 16;     // rows one thread takes at a time
constexpr std::size_t kRegionGrain = 16;  // regions one thread takes at a time

}  // namespace

void squareGradients(const PyramidLevel& level, int y, const ResponseSlope* slope, float* squared) {
  const int width = level.width();
  std::fill(squared, squared + width, 0.0F);
  if (y == 0 || y == level.height() - 1) return;
  const float* here = level.row(y);
  const float* above = here - width;
  const float* below = here + width;
  for (int x = 1; x < width - 1; ++x) {
    const float dx = 0.5F * (here[x + 1] - here[x - 1]);
    const float dy = 0.5F * (below[x] - above[x]);
    const float value = dx * dx + dy * dy;
    const bool valid = value + here[x] == value + here[x];  // no NaN
    squared[x] = valid ? value : 0.0F;
  }
  if (slope == nullptr) return;
  for (int x = 1; x < width - 1; ++x) {
    if (squared[x] == 0) continue;
    // The response is not known well at its ends. @source DSO as published
    const float grey = std::clamp(here[x] + 0.5F, 5.0F, 250.0F);
    const float factor = (*slope)[static_cast<std::size_t>(grey)];
    squared[x] = squared[x] * factor * factor;
  }
}

void RegionThresholds::resize(int width, int height) {
  width_ = width;
  regions_x_ = std::max(1, width / kRegionSize);
  regions_y_ = std::max(1, height / kRegionSize);
  squared_gradients_.resize(static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  thresholds_.resize(static_cast<std::size_t>(regions_x_) * static_cast<std::size_t>(regions_y_));
  squared_thresholds_.resize(thresholds_.size());
}

void RegionThresholds::compute(const Frame& frame) {
  const PyramidLevel& level = frame.level(0);
  resize(level.width(), level.height());
  const ResponseSlope* slope = frame.responseSlope();
  const auto rows = static_cast<std::size_t>(level.height());
  forEachRange(rows, kRowGrain, [&](std::size_t begin, std::size_t end) {
    for (auto y = static_cast<int>(begin); y < static_cast<int>(end); ++y) {
      squareGradients(
          level, y, slope, squared_gradients_.data() + static_cast<std::ptrdiff_t>(y) * width_);
    }
  });
  medianGradients(level);
  smoothAndSquare();
}

void RegionThresholds::medianGradients(const PyramidLevel& level) {
  forEachRange(thresholds_.size(), kRegionGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t region = begin; region < end; ++region) {
      thresholds_[region] =
          static_cast<float>(medianGradient(level, static_cast<int>(region)) + kAboveMedian);
    }
  });
}

int RegionThresholds::medianGradient(const PyramidLevel& level, int region) const {
  const int left = region % regions_x_ * kRegionSize;
  const int top = region / regions_x_ * kRegionSize;
  const int begin_x = std::max(left, 1);
  const int width = std::min(left + kRegionSize, level.width() - 1) - begin_x;
  const int end_y = std::min(top + kRegionSize, level.height() - 1);
  std::array<int, kGradientBins> histogram{};
  std::array<int, kRegionSize> bins{};
  int count = 0;
  for (int y = std::max(top, 1); y < end_y; ++y) {
    const float* squared = squaredGradients(y) + begin_x;
    const float* row = level.row(y) + begin_x;
    for (int i = 0; i < width; ++i) {  // apart from the counting: several at once
      bins[static_cast<std::size_t>(i)] =
          static_cast<int>(std::min(std::sqrt(squared[i]), kGradientBins - 1.0F));
    }
    for (int i = 0; i < width; ++i) {
      const int valid = std::isfinite(row[i]) ? 1 : 0;
      histogram[static_cast<std::size_t>(bins[static_cast<std::size_t>(i)])] += valid;
      count += valid;
    }
  }
  const int half = (count + 1) / 2;
  int bin = 0;
  for (int sum = histogram[0]; sum <= half && bin < kGradientBins - 1;) {
    sum += histogram[static_cast<std::size_t>(++bin)];
  }
  return count > 0 ? bin : 0;
}

void RegionThresholds::smoothAndSquare() {
  for (int y = 0; y < regions_y_; ++y) {
    for (int x = 0; x < regions_x_; ++x) {
      float sum = 0;
      int count = 0;
      for (int v = std::max(y - 1, 0); v <= std::min(y + 1, regions_y_ - 1); ++v) {
        for (int u = std::max(x - 1, 0); u <= std::min(x + 1, regions_x_ - 1); ++u) {
          sum += thresholds_[index(u, v)];
          ++count;
        }
      }
      const float mean = sum / static_cast<float>(count);
      squared_thresholds_[index(x, y)] = mean * mean;
    }
  }
}

}  // namespace dsorb
