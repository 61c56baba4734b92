// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/image/pyramid.h"

#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

namespace dsorb {
namespace {

constexpr int kMaxLevels = 5;
constexpr int kMinPixelsToHalve = 5000;
constexpr int kMinSide = 16;  // [px]

template <typename Pixel>
void copyIntensity(const ImageView& image, ImageSample* level) {
  for (int y = 0; y < image.height(); ++y) {
    const Pixel* source = image.row<Pixel>(y);
    for (int x = 0; x < image.width(); ++x) {
      (level++)->intensity = static_cast<float>(source[x]);
    }
  }
}

void halve(const PyramidLevel& fine, ImageSample* coarse) {
  const int width = fine.width() / 2;
  for (int y = 0; y < fine.height() / 2; ++y) {
    const ImageSample* top = fine.row(2 * y);
    const ImageSample* bottom = fine.row(2 * y + 1);
    for (int x = 0; x < width; ++x) {
      (coarse++)->intensity = 0.25F * (top[2 * x].intensity + top[2 * x + 1].intensity +
                                       bottom[2 * x].intensity + bottom[2 * x + 1].intensity);
    }
  }
}

/// Zero where either neighbour or the pixel itself is invalid.
float centralDifference(float before, float after) {
  const float difference = 0.5F * (after - before);
  return std::isfinite(difference) ? difference : 0.0F;
}

void differentiate(ImageSample* level, int width, int height) {
  const auto stride = static_cast<std::ptrdiff_t>(width);
  for (int y = 0; y < height; ++y) {
    const bool outer_row = y == 0 || y == height - 1;
    for (int x = 0; x < width; ++x, ++level) {
      const bool outer = outer_row || x == 0 || x == width - 1 || !std::isfinite(level->intensity);
      level->dx = outer ? 0.0F : centralDifference(level[-1].intensity, level[1].intensity);
      level->dy =
          outer ? 0.0F : centralDifference(level[-stride].intensity, level[stride].intensity);
    }
  }
}

}  // namespace

int pyramidLevels(int width, int height) {
  int levels = 1;
  while (levels < kMaxLevels && width % 2 == 0 && height % 2 == 0 &&
         width * height > kMinPixelsToHalve) {
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
  samples_ = std::unique_ptr<ImageSample[]>(new ImageSample[total]);
  ImageSample* next = samples_.get();
  for (int l = 0; l < count; ++l) {
    const PyramidLevel level(next, image.width() >> l, image.height() >> l);
    if (l > 0) {
      halve(levels_.back(), next);
    } else if (image.type() == ImageView::Type::kFloat) {
      copyIntensity<float>(image, next);
    } else {
      copyIntensity<std::uint8_t>(image, next);
    }
    differentiate(next, level.width(), level.height());
    levels_.push_back(level);
    next += static_cast<std::ptrdiff_t>(level.width()) * level.height();
  }
}

}  // namespace dsorb
