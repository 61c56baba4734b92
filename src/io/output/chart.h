// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>

#include <string>
#include <vector>

namespace dsorb::io {

/// Closed interval of data values.
struct Interval {
  double low = 0;
  double high = 1;
  [[nodiscard]] double length() const { return high - low; }
};

/// Smallest interval with round ends (a multiple of `step`) around the values.
struct RoundAxis {
  Interval interval;
  double step = 1;  ///< between ticks: 1, 2 or 5 times a power of ten
};
[[nodiscard]] RoundAxis roundAxis(const Interval& values, int ticks);

/// A plot area inside an image: frame, grid with labelled ticks, curves, in the colours of one
/// plain style.
class Chart {
 public:
  /// @param area of the whole chart in the canvas, labels included [px]
  Chart(cv::Mat& canvas, const cv::Rect& area, const std::string& title);

  /// Sets the data range and draws grid, ticks and their numbers.
  void axes(const RoundAxis& x, const RoundAxis& y, const std::string& x_label);

  void curve(const std::vector<cv::Point2d>& points, const cv::Scalar& colour);
  void dots(const std::vector<cv::Point2d>& points, int radius, const cv::Scalar& colour);
  /// Fills the vertical strip between two x values.
  void band(double x_begin, double x_end, const cv::Scalar& colour);
  /// Size of the area that data is drawn in [px].
  [[nodiscard]] cv::Size plotSize() const { return plot_.size(); }

 private:
  /// Pixel of a data point, in the 1/16 px of OpenCV's drawing functions.
  [[nodiscard]] cv::Point toPixel(const cv::Point2d& point) const;

  cv::Mat canvas_;
  cv::Rect plot_;
  Interval x_;
  Interval y_;
};

/// Text in the style of all figures; (x, y) is its left base point.
void drawText(cv::Mat& canvas, const std::string& text, const cv::Point& at, double scale = 0.45);

/// A blank figure.
[[nodiscard]] cv::Mat blankCanvas(int width, int height);

}  // namespace dsorb::io
