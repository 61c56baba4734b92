// SPDX-License-Identifier: BSD-3-Clause
#include "io/input/pixel_patterns.h"

#include <opencv2/imgproc.hpp>

#include <cmath>
#include <cstdlib>

namespace dsorb {
namespace {

constexpr int kCells = 16;  // of 2x2 pixels, on each side of a block
// No block votes for a mosaic in 450 images of 16 cameras. In the images of six of them that were
// made into mosaics, .04 to .74 of the blocks do with white balance, .98 and more without.
constexpr double kLeastShare = 0.1;
constexpr double kLeastContrast = 0.02;  // of the block's mean
constexpr double kMosaicSigmas = 5;
constexpr double kDarkShare = 8. / 255;  // of the largest value that the image has

// No block of these 450 images votes for interlacing. In an interlaced hand-held video .1 to .8 of
// them do where the camera moves, fewer where it nearly stands.
constexpr int kGrid = 8;              // blocks looked at, across and down
constexpr int kBlock = 16;            // [px]
constexpr int kLeastTextured = 16;    // blocks
constexpr int kLeastDifference = 3;   // mean of neighbouring rows [grey levels]
constexpr double kRowRatio = 1.5;     // of differences to the next row and to the one after it
constexpr double kCombedShare = 0.1;  // of the blocks

enum class Vote { kDark, kPlain, kMosaic };

/// @tparam Pixel std::uint8_t or std::uint16_t
template <typename Pixel>
Vote voteOf(const cv::Mat& image, int left, int top, double dark) {
  double sum = 0;
  double difference = 0;
  double squares = 0;
  for (int y = top; y < top + 2 * kCells; y += 2) {
    const auto* upper = image.ptr<Pixel>(y) + left;
    const auto* lower = image.ptr<Pixel>(y + 1) + left;
    for (int x = 0; x < 2 * kCells; x += 2) {
      const double d = upper[x] - upper[x + 1] - lower[x] + lower[x + 1];
      sum += upper[x] + upper[x + 1] + lower[x] + lower[x + 1];
      difference += d;
      squares += d * d;
    }
  }
  constexpr double kCount = kCells * kCells;
  const double mean = sum / kCount;  // of four pixels
  if (mean < 4 * dark) return Vote::kDark;
  const double contrast = std::abs(difference) / kCount;
  const double sigma = std::sqrt((squares / kCount - contrast * contrast) / kCount);
  return contrast > kLeastContrast * mean && contrast > kMosaicSigmas * sigma ? Vote::kMosaic
                                                                              : Vote::kPlain;
}

}  // namespace

std::optional<bool> isMosaic(const cv::Mat& image) {
  const bool deep = image.depth() == CV_16U;
  double largest = 255;
  if (deep) cv::minMaxLoc(image, nullptr, &largest);
  int votes = 0;
  int light = 0;
  int blocks = 0;
  for (int y = 0; y + 2 * kCells <= image.rows; y += 2 * kCells) {
    for (int x = 0; x + 2 * kCells <= image.cols; x += 2 * kCells) {
      const Vote vote = deep ? voteOf<std::uint16_t>(image, x, y, kDarkShare * largest)
                             : voteOf<std::uint8_t>(image, x, y, kDarkShare * largest);
      ++blocks;
      light += vote != Vote::kDark ? 1 : 0;
      votes += vote == Vote::kMosaic ? 1 : 0;
    }
  }
  if (2 * light < blocks || light == 0) return std::nullopt;
  return votes > kLeastShare * light;
}

bool isInterlaced(const cv::Mat& image) {
  const int channels = image.channels();
  if (image.depth() != CV_8U || image.rows < 2 * kBlock || image.cols < kBlock) return false;
  int textured = 0;
  int votes = 0;
  for (int block = 0; block < kGrid * kGrid; ++block) {
    const int top = (image.rows - kBlock - 2) * (block / kGrid) / (kGrid - 1);
    const int left = (image.cols - kBlock) * (block % kGrid) / (kGrid - 1);
    int next = 0;
    int after = 0;
    for (int y = top; y < top + kBlock; ++y) {
      for (int x = left; x < left + kBlock; ++x) {
        const int at = x * channels + channels / 2;  // green
        next += std::abs(image.ptr(y)[at] - image.ptr(y + 1)[at]);
        after += std::abs(image.ptr(y)[at] - image.ptr(y + 2)[at]);
      }
    }
    if (next < kLeastDifference * kBlock * kBlock) continue;
    ++textured;
    votes += next > kRowRatio * after ? 1 : 0;
  }
  return textured >= kLeastTextured && votes > kCombedShare * textured;
}

cv::Mat greyOfMosaic(const cv::Mat& image) {
  const cv::Mat kernel = (cv::Mat_<float>(1, 3) << 0.25F, 0.5F, 0.25F);
  cv::Mat grey;
  cv::sepFilter2D(image, grey, -1, kernel, kernel, cv::Point(-1, -1), 0, cv::BORDER_REFLECT_101);
  return grey;
}

}  // namespace dsorb
