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

/// Intensities alone, row-major: what the samples of a level are made of.
struct Plane {
  const float* data = nullptr;
  std::ptrdiff_t stride = 0;  // [float]
  int width = 0;
  int height = 0;
  [[nodiscard]] const float* row(int y) const { return data + y * stride; }
};

/// The image itself where it holds floats, else a copy.
Plane planeOf(const ImageView& image, std::vector<float>& copy) {
  const auto width = static_cast<std::size_t>(image.width());
  if (image.type() == ImageView::Type::kFloat) {
    const std::ptrdiff_t stride =
        image.height() > 1 ? image.row<float>(1) - image.row<float>(0) : 0;
    return {image.row<float>(0), stride, image.width(), image.height()};
  }
  copy.resize(width * static_cast<std::size_t>(image.height()));
  for (int y = 0; y < image.height(); ++y) {
    const auto* source = image.row<std::uint8_t>(y);
    std::copy(source, source + width, copy.data() + static_cast<std::size_t>(y) * width);
  }
  return {copy.data(), image.width(), image.width(), image.height()};
}

DSORB_TARGET_CLONES
Plane halve(const Plane& fine, float* coarse) {
  const Plane result{coarse, fine.width / 2, fine.width / 2, fine.height / 2};
  for (int y = 0; y < result.height; ++y, coarse += result.width) {
    const float* top = fine.row(2 * y);
    const float* bottom = fine.row(2 * y + 1);
    for (int x = 0; x < result.width; ++x) {
      const int left = 2 * x;
      coarse[x] = 0.25F * (top[left] + top[left + 1] + bottom[left] + bottom[left + 1]);
    }
  }
  return result;
}

inline bool isFinite(float value) {
  return std::abs(value) <= std::numeric_limits<float>::max();
}

void fillOuterRow(const float* row, int width, ImageSample* samples) {
  for (int x = 0; x < width; ++x) samples[x] = {row[x], 0.0F, 0.0F};
}

/// Samples of a level: intensity and central differences, zero where a neighbour or the pixel
/// itself is invalid.
DSORB_TARGET_CLONES
void differentiate(const Plane& plane, ImageSample* samples) {
  const int width = plane.width;
  fillOuterRow(plane.row(0), width, samples);
  for (int y = 1; y < plane.height - 1; ++y) {
    samples += width;
    const float* above = plane.row(y - 1);
    const float* here = plane.row(y);
    const float* below = plane.row(y + 1);
    for (int x = 1; x < width - 1; ++x) {
      const float dx = 0.5F * (here[x + 1] - here[x - 1]);
      const float dy = 0.5F * (below[x] - above[x]);
      const bool valid = isFinite(here[x]);
      samples[x].intensity = here[x];
      samples[x].dx = (valid & isFinite(dx)) ? dx : 0.0F;
      samples[x].dy = (valid & isFinite(dy)) ? dy : 0.0F;
    }
    samples[0] = {here[0], 0.0F, 0.0F};
    samples[width - 1] = {here[width - 1], 0.0F, 0.0F};
  }
  fillOuterRow(plane.row(plane.height - 1), width, samples + width);
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
  std::vector<float> copy;
  std::vector<float> coarse(total - static_cast<std::size_t>(image.width()) *
                                        static_cast<std::size_t>(image.height()));
  Plane plane = planeOf(image, copy);
  ImageSample* next = samples_.get();
  float* next_plane = coarse.data();
  for (int l = 0; l < count; ++l) {
    if (l > 0) {
      plane = halve(plane, next_plane);
      next_plane += static_cast<std::ptrdiff_t>(plane.width) * plane.height;
    }
    differentiate(plane, next);
    levels_.emplace_back(next, plane.width, plane.height);
    next += static_cast<std::ptrdiff_t>(plane.width) * plane.height;
  }
}

}  // namespace dsorb
