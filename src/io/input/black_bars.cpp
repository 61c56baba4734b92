// SPDX-License-Identifier: BSD-3-Clause
#include "io/input/black_bars.h"

#include <fmt/format.h>
#include <opencv2/core.hpp>

#include <algorithm>
#include <cstdlib>

namespace dsorb {
namespace {

constexpr int kBlack = 24;        // brightest grey level of a bar; video has 16 and its noise
constexpr int kEven = 12;         // most that it varies [grey levels]
constexpr double kAlike = 0.2;    // most that two bars differ, of the wider one; or
constexpr int kAlikePixels = 4;   // [px]
constexpr double kPicture = 0.3;  // least share of the image that is picture; less: a dark image
constexpr int kBarMargin = 8;     // [px] a block of JPEG or H.264

/// Whether a line of the image looks as a bar does.
/// @param low,high of the lines before it, widened by this one
bool isBlack(const cv::Mat& line, int& low, int& high) {
  const auto widen = [&](int grey) {
    low = std::min(low, grey);
    high = std::max(high, grey);
    return high <= kBlack && high - low <= kEven;
  };
  for (int y = 0; y < line.rows; ++y) {
    const uchar* row = line.ptr(y);
    const int values = line.cols * line.channels();
    for (int i = 0; i < values; ++i) {
      if (!widen(row[i])) return false;
    }
  }
  return true;
}

/// Black lines from one side on. @param line gives the i-th one from there
template <typename Line>
int blackLines(int count, const Line& line) {
  int low = kBlack;
  int high = 0;
  int i = 0;
  while (i < count && isBlack(line(i), low, high)) ++i;
  return i;
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
