// SPDX-License-Identifier: BSD-3-Clause
#include "features/corner_detection.h"

#include "base/parallel.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <tuple>

namespace dsorb {
namespace {

constexpr int kBandRows = 64;  // that one task takes at a time
constexpr int kBlock = 3;      // side of the square whose gradients are summed [px]
constexpr int kMargin = 2;     // rows around a band: one for the square, one for the neighbours

struct Band {
  float strongest = 0;  // of all pixels, maxima or not
  std::vector<DetectedCorner> maxima;
};

/// Rows [first, last) of an image.
Band findMaxima(const cv::Mat& grey, const cv::Mat& valid, int first, int last) {
  const int top = std::max(first - kMargin, 0);
  const int bottom = std::min(last + kMargin, grey.rows);
  cv::Mat strength;
  cv::Mat highest;
  cv::cornerMinEigenVal(grey.rowRange(top, bottom), strength, kBlock);
  cv::dilate(strength, highest, cv::Mat());
  Band band;
  for (int y = first; y < last; ++y) {
    const auto* here = strength.ptr<float>(y - top);
    const auto* around = highest.ptr<float>(y - top);
    const auto* usable = valid.empty() ? nullptr : valid.ptr<std::uint8_t>(y);
    const bool outermost_row = y == 0 || y == grey.rows - 1;
    for (int x = 0; x < grey.cols; ++x) {
      if (usable != nullptr && usable[x] == 0) continue;
      band.strongest = std::max(band.strongest, here[x]);
      const bool outermost = outermost_row || x == 0 || x == grey.cols - 1;
      if (here[x] > 0 && here[x] == around[x] && !outermost) {
        band.maxima.push_back({here[x], x, y});
      }
    }
  }
  return band;
}

/// The order of corners: among equally strong ones the lowest and rightmost comes first, as with
/// OpenCV.
bool isStronger(const DetectedCorner& a, const DetectedCorner& b) {
  return std::tie(a.strength, a.y, a.x) > std::tie(b.strength, b.y, b.x);
}

}  // namespace

std::vector<DetectedCorner> detectCorners(const cv::Mat& grey,
                                          const cv::Mat& valid,
                                          double quality) {
  std::vector<Band> bands(static_cast<std::size_t>((grey.rows + kBandRows - 1) / kBandRows));
  forEachRange(bands.size(), 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const int first = static_cast<int>(i) * kBandRows;
      bands[i] = findMaxima(grey, valid, first, std::min(first + kBandRows, grey.rows));
    }
  });
  float strongest = 0;
  for (const Band& band : bands) strongest = std::max(strongest, band.strongest);
  const auto least = static_cast<float>(quality * strongest);
  std::vector<DetectedCorner> corners;
  for (const Band& band : bands) {
    std::copy_if(band.maxima.begin(),
                 band.maxima.end(),
                 std::back_inserter(corners),
                 [&](const DetectedCorner& corner) { return corner.strength > least; });
  }
  std::sort(corners.begin(), corners.end(), isStronger);
  return corners;
}

}  // namespace dsorb
