// SPDX-License-Identifier: BSD-3-Clause
#include "io/output/figures.h"

#include "dsorb/error.h"

#include "io/output/output_file.h"
#include "io/png.h"

#include <fmt/format.h>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <string>
#include <utility>
#include <vector>

namespace dsorb::io {
namespace {

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

/// A blank figure.
cv::Mat blankCanvas(int width, int height) {
  return {height, width, CV_8UC3, cv::Scalar::all(255)};
}

/// Text in the style of all figures; (x, y) is its left base point.
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

constexpr int kPngCompression = 3;
constexpr int kBarWidth = 90;
constexpr double kMaxFigureWidth = 1600;  // [px]
constexpr std::size_t kMaxPanels = 4;
constexpr int kFirstColour = 26;
constexpr int kLastColour = 240;
const cv::Scalar kPathColour(180, 110, 30);
const cv::Scalar kKeyframeColour(40, 40, 220);
const cv::Scalar kStartColour(60, 160, 40);

float quantile(std::vector<float> values, double share) {
  if (values.empty()) return 0;
  const auto rank = static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), values.begin() + rank, values.end());
  return values[static_cast<std::size_t>(rank)];
}

/// 256 colours from far (blue) to near (red), without the dark ends of the map.
cv::Mat inverseDepthColours() {
  cv::Mat ramp(1, 256, CV_8UC1);
  for (int i = 0; i < 256; ++i) {
    ramp.at<uchar>(0, i) =
        static_cast<uchar>(kFirstColour + i * (kLastColour - kFirstColour) / 255);
  }
  cv::Mat colours;
  cv::applyColorMap(ramp, colours, cv::COLORMAP_TURBO);
  return colours;
}

void drawColourBar(cv::Mat& canvas, const cv::Mat& colours, float low, float high) {
  const int left = canvas.cols - kBarWidth + 10;
  const int top = 24;
  const int height = canvas.rows - 2 * top;
  for (int y = 0; y < height; ++y) {
    const int index = 255 - 255 * y / std::max(1, height - 1);
    canvas(cv::Rect(left, top + y, 16, 1)).setTo(colours.at<cv::Vec3b>(0, index));
  }
  for (int i = 0; i <= 4; ++i) {
    const float value = high + (low - high) * static_cast<float>(i) / 4;
    drawText(canvas,
             fmt::format("{:.2f}", static_cast<double>(value)),
             {left + 22, top + 5 + (height - 1) * i / 4},
             0.4);
  }
  drawText(canvas, "1/depth", {left, 14}, 0.4);
}

/// Points of one segment seen from above: x to the right, z up.
struct SegmentPath {
  int segment = 0;
  bool metric = false;  // in metres
  std::vector<cv::Point2d> frames;
  std::vector<cv::Point2d> keyframes;
};

/// Segments with the most frames, in the order of the sequence.
std::vector<int> longestSegments(const RunRecord& record) {
  std::map<int, std::size_t> lengths;
  for (std::size_t i = 0; i < record.frames().size(); ++i) {
    ++lengths[record.segmentOf(record.frames().at(i))];
  }
  std::vector<std::pair<std::size_t, int>> ranked;
  ranked.reserve(lengths.size());
  for (const auto& [segment, length] : lengths) ranked.emplace_back(length, -segment);
  std::sort(ranked.rbegin(), ranked.rend());
  ranked.resize(std::min(ranked.size(), kMaxPanels));
  std::vector<int> segments;
  segments.reserve(ranked.size());
  for (const auto& place : ranked) segments.push_back(-place.second);
  std::sort(segments.begin(), segments.end());
  return segments;
}

/// Places of the entries of these segments, a list each.
std::vector<std::vector<cv::Point2d>> topViews(const RunRecord& record,
                                               const Entries& entries,
                                               const std::vector<int>& segments) {
  std::vector<std::vector<cv::Point2d>> views(segments.size());
  for (std::size_t i = 0; i < entries.size(); ++i) {
    const PosedEntry entry = entries.at(i);
    const int segment = record.segmentOf(entry);
    const auto found = std::lower_bound(segments.begin(), segments.end(), segment);
    if (found == segments.end() || *found != segment) continue;
    const Eigen::Vector3d place = record.T_world_cam(entry).translation();
    views[static_cast<std::size_t>(found - segments.begin())].emplace_back(place.x(), place.z());
  }
  return views;
}

std::vector<SegmentPath> longestPaths(const RunRecord& record) {
  const std::vector<int> segments = longestSegments(record);
  auto frames = topViews(record, record.frames(), segments);
  auto keyframes = topViews(record, record.keyframes(), segments);
  std::vector<SegmentPath> paths;
  for (std::size_t i = 0; i < segments.size(); ++i) {
    paths.push_back({segments[i],
                     record.unitOf(segments[i]).has_value(),
                     std::move(frames[i]),
                     std::move(keyframes[i])});
  }
  return paths;
}

void include(Interval& interval, double value) {
  interval.low = std::min(interval.low, value);
  interval.high = std::max(interval.high, value);
}

/// Makes the range cover `length` around its middle.
Interval widened(const Interval& interval, double length) {
  const double margin = 0.5 * std::max(0.0, length - interval.length());
  return {interval.low - margin, interval.high + margin};
}

void drawPath(cv::Mat& canvas, const cv::Rect& area, const SegmentPath& path) {
  Interval x{0, 0};  // the origin, the reference camera, is always in view
  Interval z{0, 0};
  for (const cv::Point2d& point : path.frames) {
    include(x, point.x);
    include(z, point.y);
  }
  Chart chart(canvas,
              area,
              fmt::format("segment {}: {} frames (blue), {} keyframes (red), start green",
                          path.segment,
                          path.frames.size(),
                          path.keyframes.size()));
  // One unit is equally long on both axes.
  const double per_pixel =
      std::max({x.length() / chart.plotSize().width, z.length() / chart.plotSize().height, 1e-6}) *
      1.1;
  x = widened(x, per_pixel * chart.plotSize().width);
  z = widened(z, per_pixel * chart.plotSize().height);
  const double step = std::max(roundAxis(x, 8).step, roundAxis(z, 8).step);
  chart.axes(RoundAxis{x, step},
             RoundAxis{z, step},
             path.metric ? "x right, z up [m]"
                         : "x right, z up; unit: mean inverse depth of the reference is 1");
  chart.curve(path.frames, kPathColour);
  chart.dots(path.keyframes, 4, kKeyframeColour);
  chart.dots({{0, 0}}, 5, kStartColour);
}

cv::Scalar stateColour(OdometryState state) {
  switch (state) {
    case OdometryState::kInitializing:
      return {190, 230, 255};
    case OdometryState::kInitialized:
      return {120, 190, 120};
    case OdometryState::kTracked:
      return {235, 250, 235};
    case OdometryState::kLost:
      return {150, 150, 245};
    case OdometryState::kMissed:
      return {205, 205, 205};
  }
  return cv::Scalar::all(255);
}

void drawNotes(cv::Mat& canvas,
               const cv::Rect& area,
               const std::string& title,
               const Spool<FrameNote>& notes,
               float FrameNote::*member) {
  Interval x{std::numeric_limits<double>::max(), std::numeric_limits<double>::lowest()};
  Interval y{0, 1e-3};
  std::vector<std::vector<cv::Point2d>> curves(1);
  for (std::size_t i = 0; i < notes.size(); ++i) {
    const FrameNote note = notes.at(i);
    include(x, note.index);
    if (note.*member < 0) {
      if (!curves.back().empty()) curves.emplace_back();
      continue;
    }
    include(y, static_cast<double>(note.*member));
    curves.back().emplace_back(note.index, static_cast<double>(note.*member));
  }
  Chart chart(canvas, area, title);
  RoundAxis x_axis = roundAxis(x, 10);
  if (x_axis.step < 1) x_axis = {{x.low, std::max(x.high, x.low + 1)}, 1};
  const RoundAxis y_axis = roundAxis(y, 5);
  chart.axes(x_axis, y_axis, "");
  for (std::size_t i = 0; i < notes.size(); ++i) {
    const FrameNote note = notes.at(i);
    chart.band(note.index - 0.5, note.index + 0.5, stateColour(note.state));
  }
  chart.axes(x_axis,
             y_axis,
             "frame; orange: initializing, dark green: initialized, light green: tracked, grey: "
             "missed, red: lost");
  for (const auto& curve : curves) {
    chart.curve(curve, kPathColour);
    if (curve.size() == 1) chart.dots(curve, 2, kPathColour);
  }
}

}  // namespace

cv::Mat greyImage(const Frame& frame) {
  cv::Mat grey(frame.height(), frame.width(), CV_8UC1);
  for (int y = 0; y < grey.rows; ++y) {
    for (int x = 0; x < grey.cols; ++x) {
      const float value = frame.level(0).at(x, y).intensity;
      grey.at<uchar>(y, x) = std::isfinite(value) ? cv::saturate_cast<uchar>(value) : uchar{0};
    }
  }
  return grey;
}

cv::Mat drawInverseDepth(const InitializationResult& result) {
  const Frame& reference = *result.frames.front().frame;
  std::vector<float> values;
  for (const InitPoint& point : result.points) {
    if (point.host == 0 && std::isfinite(point.inverse_depth)) {
      values.push_back(point.inverse_depth);
    }
  }
  const float low = quantile(values, 0.02);
  const float high = std::max(quantile(values, 0.98), low + 1e-6F);

  const double scale = std::min(1.0, kMaxFigureWidth / reference.width());
  cv::Mat grey = greyImage(reference);
  if (scale < 1) cv::resize(grey, grey, {}, scale, scale, cv::INTER_AREA);
  cv::Mat canvas = blankCanvas(grey.cols + kBarWidth, grey.rows);
  cv::Mat image = canvas(cv::Rect({0, 0}, grey.size()));
  cv::cvtColor(grey, image, cv::COLOR_GRAY2BGR);
  const cv::Mat colours = inverseDepthColours();
  for (const InitPoint& point : result.points) {
    if (point.host != 0 || !std::isfinite(point.inverse_depth)) continue;
    const float place = std::clamp((point.inverse_depth - low) / (high - low), 0.0F, 1.0F);
    const auto& colour = colours.at<cv::Vec3b>(0, static_cast<int>(place * 255));
    const int x = static_cast<int>(std::lround(scale * static_cast<double>(point.pixel.x())));
    const int y = static_cast<int>(std::lround(scale * static_cast<double>(point.pixel.y())));
    const cv::Rect square(x - 1, y - 1, 3, 3);
    image(square & cv::Rect(0, 0, image.cols, image.rows)).setTo(colour);
  }
  drawColourBar(canvas, colours, low, high);
  return canvas;
}

cv::Mat drawTrajectory(const RunRecord& record) {
  const std::vector<SegmentPath> paths = longestPaths(record);
  const int columns = paths.size() > 1 ? 2 : 1;
  const int rows = std::max(1, (static_cast<int>(paths.size()) + 1) / 2);
  const cv::Size panel(columns > 1 ? 560 : 800, columns > 1 ? 480 : 680);
  cv::Mat canvas = blankCanvas(columns * panel.width, rows * panel.height);
  for (std::size_t i = 0; i < paths.size(); ++i) {
    const int column = static_cast<int>(i) % columns;
    const int row = static_cast<int>(i) / columns;
    drawPath(canvas, {{column * panel.width, row * panel.height}, panel}, paths[i]);
  }
  if (paths.empty()) drawText(canvas, "never initialized", {40, 60}, 0.6);
  return canvas;
}

cv::Mat drawTimeline(const RunRecord& record) {
  const cv::Size panel(1000, 300);
  cv::Mat canvas = blankCanvas(panel.width, 2 * panel.height);
  if (record.notes().empty()) {
    drawText(canvas, "no frames", {40, 60}, 0.6);
    return canvas;
  }
  drawNotes(canvas,
            {{0, 0}, panel},
            "tracking error, rms [grey levels]",
            record.notes(),
            &FrameNote::tracking_rmse);
  drawNotes(canvas,
            {{0, panel.height}, panel},
            "work for a frame [ms]",
            record.notes(),
            &FrameNote::milliseconds);
  return canvas;
}

void writePng(const std::filesystem::path& path, const cv::Mat& image) {
  replaceFile(path, encodePng(image, kPngCompression));
}

}  // namespace dsorb::io
