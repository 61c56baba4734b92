// SPDX-License-Identifier: BSD-3-Clause
#include "io/output/chart.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>

namespace dsorb::io {
namespace {

constexpr int kSubpixelBits = 4;
constexpr int kLeftMargin = 58;
constexpr int kRightMargin = 16;
constexpr int kTopMargin = 30;
constexpr int kBottomMargin = 44;
const cv::Scalar kInk(60, 60, 60);
const cv::Scalar kGrid(225, 225, 225);

std::string tickText(double value, double step) {
  if (std::abs(value) < 1e-9 * step) return "0";
  return fmt::format("{:.6g}", value);
}

/// Multiples of the step inside the interval.
std::vector<double> tickValues(const RoundAxis& axis) {
  const double tolerance = 1e-6;  // share of a step; keeps ends that are ticks up to rounding
  const auto first = std::lround(std::ceil(axis.interval.low / axis.step - tolerance));
  const auto last = std::lround(std::floor(axis.interval.high / axis.step + tolerance));
  std::vector<double> values;
  for (auto i = first; i <= last; ++i) values.push_back(static_cast<double>(i) * axis.step);
  return values;
}

}  // namespace

cv::Mat blankCanvas(int width, int height) {
  return {height, width, CV_8UC3, cv::Scalar::all(255)};
}

void drawText(cv::Mat& canvas, const std::string& text, const cv::Point& at, double scale) {
  cv::putText(canvas, text, at, cv::FONT_HERSHEY_SIMPLEX, scale, kInk, 1, cv::LINE_AA);
}

RoundAxis roundAxis(const Interval& values, int ticks) {
  const double length = std::max(values.length(), 1e-9);
  const double raw = length / std::max(ticks, 1);
  const double power = std::pow(10.0, std::floor(std::log10(raw)));
  double step = 10 * power;
  for (const double factor : {1.0, 2.0, 5.0}) {
    if (factor * power >= raw) {
      step = factor * power;
      break;
    }
  }
  return {{std::floor(values.low / step) * step, std::ceil(values.high / step) * step}, step};
}

Chart::Chart(cv::Mat& canvas, const cv::Rect& area, const std::string& title)
    : canvas_(canvas),
      plot_(area.x + kLeftMargin,
            area.y + kTopMargin,
            area.width - kLeftMargin - kRightMargin,
            area.height - kTopMargin - kBottomMargin) {
  drawText(canvas_, title, {plot_.x, area.y + kTopMargin - 10}, 0.5);
}

cv::Point Chart::toPixel(const cv::Point2d& point) const {
  const double scale = 1 << kSubpixelBits;
  const double x = plot_.x + (point.x - x_.low) / x_.length() * (plot_.width - 1);
  const double y = plot_.y + (y_.high - point.y) / y_.length() * (plot_.height - 1);
  return {static_cast<int>(std::lround(x * scale)), static_cast<int>(std::lround(y * scale))};
}

void Chart::axes(const RoundAxis& x, const RoundAxis& y, const std::string& x_label) {
  x_ = x.interval;
  y_ = y.interval;
  const auto line = [this](const cv::Point2d& from, const cv::Point2d& to) {
    cv::line(canvas_, toPixel(from), toPixel(to), kGrid, 1, cv::LINE_AA, kSubpixelBits);
  };
  for (const double value : tickValues(x)) {
    line({value, y_.low}, {value, y_.high});
    const std::string text = tickText(value, x.step);
    const cv::Point base(toPixel({value, y_.low}).x >> kSubpixelBits, plot_.y + plot_.height + 16);
    drawText(canvas_, text, base - cv::Point(4 * static_cast<int>(text.size()), 0), 0.4);
  }
  for (const double value : tickValues(y)) {
    line({x_.low, value}, {x_.high, value});
    const std::string text = tickText(value, y.step);
    const cv::Point base(plot_.x - 8 - 8 * static_cast<int>(text.size()),
                         (toPixel({x_.low, value}).y >> kSubpixelBits) + 4);
    drawText(canvas_, text, base, 0.4);
  }
  cv::rectangle(canvas_, plot_, kInk, 1);
  drawText(canvas_, x_label, {plot_.x, plot_.y + plot_.height + 36}, 0.42);
}

void Chart::curve(const std::vector<cv::Point2d>& points, const cv::Scalar& colour) {
  for (std::size_t i = 1; i < points.size(); ++i) {
    cv::line(
        canvas_, toPixel(points[i - 1]), toPixel(points[i]), colour, 2, cv::LINE_AA, kSubpixelBits);
  }
}

void Chart::dots(const std::vector<cv::Point2d>& points, int radius, const cv::Scalar& colour) {
  for (const cv::Point2d& point : points) {
    cv::circle(canvas_,
               toPixel(point),
               radius << kSubpixelBits,
               colour,
               cv::FILLED,
               cv::LINE_AA,
               kSubpixelBits);
  }
}

void Chart::band(double x_begin, double x_end, const cv::Scalar& colour) {
  const cv::Point from = toPixel({x_begin, y_.high});
  const cv::Point to = toPixel({x_end, y_.low});
  const int left = from.x >> kSubpixelBits;
  const int right = to.x >> kSubpixelBits;
  const cv::Rect strip(left, plot_.y + 1, std::max(1, right - left), plot_.height - 2);
  canvas_(strip & plot_).setTo(colour);
}

}  // namespace dsorb::io
