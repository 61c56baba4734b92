// SPDX-License-Identifier: BSD-3-Clause
#include "io/input/pixel_patterns.h"

#include <fmt/format.h>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace dsorb {
namespace {

constexpr int kTypeBits = 16;
constexpr int kDarkBits = 14;  // up to here a whole image stays below a quarter of the range

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

/// @param image of 16 bits
Vote voteOf(const cv::Mat& image, int left, int top, double dark) {
  double sum = 0;
  double difference = 0;
  double squares = 0;
  for (int y = top; y < top + 2 * kCells; y += 2) {
    const auto* upper = image.ptr<std::uint16_t>(y) + left;
    const auto* lower = image.ptr<std::uint16_t>(y + 1) + left;
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

constexpr int kBlack = 24;        // brightest grey level of a bar; video has 16 and its noise
constexpr int kEven = 12;         // most that it varies [grey levels]
constexpr double kAlike = 0.2;    // most that two bars differ, of the wider one; or
constexpr int kAlikePixels = 4;   // [px]
constexpr double kPicture = 0.3;  // least share of the image that is picture; less: a dark image
constexpr int kBarMargin = 8;     // [px] a block of JPEG or H.264

/// Black lines from one side on: least and greatest of all of them as a bar's.
/// @param line gives the i-th one from there
template <typename Line>
int blackLines(int count, const Line& line) {
  double low = kBlack;
  double high = 0;
  for (int i = 0; i < count; ++i) {
    double least = 0;
    double most = 0;
    cv::minMaxLoc(cv::Mat(line(i)).reshape(1), &least, &most);
    low = std::min(low, least);
    high = std::max(high, most);
    if (high > kBlack || high - low > kEven) return i;
  }
  return count;
}

/// Both, or none where they are not alike.
void keepAlike(int& first, int& second) {
  const int wider = std::max(first, second);
  const double allowed = std::max<double>(kAlikePixels, kAlike * wider);
  const bool alike = first > 0 && second > 0 && std::abs(first - second) <= allowed;
  if (!alike) first = second = 0;
}

bool isMostlyBlack(const BlackBars& bars, cv::Size size) {
  return size.width - bars.left - bars.right < kPicture * size.width ||
         size.height - bars.top - bars.bottom < kPicture * size.height;
}

BlackBars barsOf(const cv::Mat& image) {
  const int w = image.cols;
  const int h = image.rows;
  BlackBars bars;
  bars.left = blackLines(w, [&](int i) { return image.col(i); });
  bars.right = blackLines(w, [&](int i) { return image.col(w - 1 - i); });
  bars.top = blackLines(h, [&](int i) { return image.row(i); });
  bars.bottom = blackLines(h, [&](int i) { return image.row(h - 1 - i); });
  return bars;
}

}  // namespace

BitDepth recogniseBitDepth(std::uint16_t largest) {
  for (const int bits : {10, 12}) {
    if (largest >> static_cast<unsigned>(bits) != 0) continue;
    return {bits,
            fmt::format("16-bit images with values up to {} are taken for {}-bit ones; --bits 16 "
                        "takes them as they are",
                        largest,
                        bits)};
  }
  if (largest >> static_cast<unsigned>(kDarkBits) != 0) return {kTypeBits, ""};
  return {kTypeBits,
          fmt::format("16-bit images with values up to {} only; if the camera has fewer bits, say "
                      "how many with --bits",
                      largest)};
}

std::optional<bool> isMosaic(const cv::Mat& image) {
  double largest = 255;
  if (image.depth() == CV_16U) cv::minMaxLoc(image, nullptr, &largest);
  cv::Mat deep;
  image.convertTo(deep, CV_16U);
  int votes = 0;
  int light = 0;
  int blocks = 0;
  for (int y = 0; y + 2 * kCells <= image.rows; y += 2 * kCells) {
    for (int x = 0; x + 2 * kCells <= image.cols; x += 2 * kCells) {
      const Vote vote = voteOf(deep, x, y, kDarkShare * largest);
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

bool BarFinder::look(const cv::Mat& image) {
  if (image.depth() != CV_8U || (begun_ && !bars_.any())) return false;
  BlackBars seen = barsOf(image);
  if (isMostlyBlack(seen, image.size())) return false;
  if (begun_) {
    seen = {std::min(seen.left, bars_.left),
            std::min(seen.right, bars_.right),
            std::min(seen.top, bars_.top),
            std::min(seen.bottom, bars_.bottom)};
  }
  keepAlike(seen.left, seen.right);
  keepAlike(seen.top, seen.bottom);
  const bool changed = seen.left != bars_.left || seen.right != bars_.right ||
                       seen.top != bars_.top || seen.bottom != bars_.bottom;
  bars_ = seen;
  begun_ = true;
  return changed;
}

cv::Mat withoutBars(const BlackBars& bars, cv::Size size, const cv::Mat& mask) {
  if (!bars.any()) return mask;
  const auto beside = [](int bar) { return bar > 0 ? bar + kBarMargin : 0; };
  const cv::Point begin(beside(bars.left), beside(bars.top));
  const cv::Point end(size.width - beside(bars.right), size.height - beside(bars.bottom));
  const cv::Rect picture = cv::Rect(begin, end) & cv::Rect({}, size);
  cv::Mat kept = cv::Mat::zeros(size, CV_8U);
  if (mask.empty()) {
    kept(picture) = 255;
  } else {
    mask(picture).copyTo(kept(picture));
  }
  return cv::countNonZero(kept) > 0 ? kept : mask;
}

std::string describe(const BlackBars& bars) {
  return fmt::format(
      "black bars ({} px on the left, {} on the right, {} at the top, {} at the bottom) are left "
      "out, as a mask does",
      bars.left,
      bars.right,
      bars.top,
      bars.bottom);
}

}  // namespace dsorb
