// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/image/pyramid.h"

#include "base/target_clones.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <stdexcept>
#include <string>

namespace dsorb {
namespace {

constexpr int kMaxLevels = 5;
constexpr int kMinPixelsToHalve = 5000;
constexpr int kMinSide = 16;  // [px]

DSORB_TARGET_CLONES
void copyRow(const float* source, int width, float* intensities) {
  constexpr float kInvalid = std::numeric_limits<float>::quiet_NaN();
  for (int x = 0; x < width; ++x) {
    const bool finite = std::abs(source[x]) <= std::numeric_limits<float>::max();
    intensities[x] = finite ? source[x] : kInvalid;
  }
}

void copyImage(const ImageView& image, float* intensities) {
  for (int y = 0; y < image.height(); ++y, intensities += image.width()) {
    if (image.type() == ImageView::Type::kFloat) {
      copyRow(image.row<float>(y), image.width(), intensities);
    } else {
      const auto* source = image.row<std::uint8_t>(y);
      std::copy(source, source + image.width(), intensities);
    }
  }
}

DSORB_TARGET_CLONES
void halve(const PyramidLevel& fine, float* coarse) {
  const int width = fine.width() / 2;
  for (int y = 0; y < fine.height() / 2; ++y, coarse += width) {
    const float* top = fine.row(2 * y);
    const float* bottom = fine.row(2 * y + 1);
    for (int x = 0; x < width; ++x) {
      const int left = 2 * x;
      coarse[x] = 0.25F * (top[left] + top[left + 1] + bottom[left] + bottom[left + 1]);
    }
  }
}

}  // namespace

int pyramidLevels(int width, int height) {
  int levels = 1;
  while (levels < kMaxLevels && width % 2 == 0 && height % 2 == 0 &&
         std::int64_t{width} * height > kMinPixelsToHalve) {
    width /= 2;
    height /= 2;
    ++levels;
  }
  return levels;
}

Pyramid::Pyramid(const ImageView& image) {
  if (image.empty() || image.width() < kMinSide || image.height() < kMinSide) {
    throw std::invalid_argument("image of " + std::to_string(image.width()) + "x" +
                                std::to_string(image.height()) + " pixels: at least " +
                                std::to_string(kMinSide) + " a side are needed");
  }
  const int count = pyramidLevels(image.width(), image.height());
  std::size_t total = 0;
  for (int l = 0; l < count; ++l) {
    total += static_cast<std::size_t>(image.width() >> l) *
             static_cast<std::size_t>(image.height() >> l);
  }
  intensities_ = std::unique_ptr<float[]>(new float[total]);
  float* next = intensities_.get();
  for (int l = 0; l < count; ++l) {
    if (l == 0) {
      copyImage(image, next);
    } else {
      halve(levels_.back(), next);
    }
    levels_.emplace_back(next, image.width() >> l, image.height() >> l);
    next += static_cast<std::ptrdiff_t>(levels_.back().width()) * levels_.back().height();
  }
}

}  // namespace dsorb
