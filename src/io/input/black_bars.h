// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core/mat.hpp>

#include <string>

namespace dsorb {

/// Bars beside a picture of another shape than the image's (letterbox, pillarbox) [px].
struct BlackBars {
  int left = 0;
  int right = 0;
  int top = 0;
  int bottom = 0;

  [[nodiscard]] bool any() const { return left > 0 || right > 0 || top > 0 || bottom > 0; }
};

/// What stays black in all images of a sequence, at opposite sides alike. The edge of such a bar
/// never moves and would bend any map.
class BarFinder {
 public:
  /// Looks at the next image; of other than 8 bits nothing is known.
  /// @return whether the bars have changed, as with the first image that has some
  bool look(const cv::Mat& image);
  [[nodiscard]] const BlackBars& bars() const { return bars_; }

 private:
  BlackBars bars_;
  bool begun_ = false;
};

/// 0 where a mask hides, in the bars or beside them, where compression blurs their edge.
/// @param mask of the sequence; empty: none
[[nodiscard]] cv::Mat withoutBars(const BlackBars& bars, cv::Size size, const cv::Mat& mask);

/// What the user is told of the bars.
[[nodiscard]] std::string describe(const BlackBars& bars);

}  // namespace dsorb
