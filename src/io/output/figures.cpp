// SPDX-License-Identifier: BSD-3-Clause
#include "io/output/figures.h"

#include "dsorb/error.h"

#include "io/output/output_file.h"

#include <fmt/format.h>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <png.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace dsorb::io {
namespace {

constexpr int kSubpixelBits = 4;

/// Data values along a line of pixels.
struct Axis {
  int first = 0;  ///< pixel of `low`
  int last = 0;   ///< pixel of `high`
  double low = 0;
  double high = 0;

  [[nodiscard]] double length() const { return high - low; }
  void include(double value) {
    low = std::min(low, value);
    high = std::max(high, value);
  }
  void widenTo(double length) {
    const double margin = 0.5 * (length - this->length());
    low -= margin;
    high += margin;
  }
  /// In the 1/16 px of OpenCV's drawing functions.
  [[nodiscard]] int subpixel(double value) const {
    const double pixel = first + (value - low) / length() * (last - first);
    return static_cast<int>(std::lround(pixel * (1 << kSubpixelBits)));
  }
};

constexpr int kLeftMargin = 58;
constexpr int kRightMargin = 16;
constexpr int kTopMargin = 30;
constexpr int kBottomMargin = 44;
const cv::Scalar kInk(60, 60, 60);
const cv::Scalar kGrid(225, 225, 225);

/// A blank figure.
cv::Mat blankCanvas(int width, int height) {
  return {height, width, CV_8UC3, cv::Scalar::all(255)};
}

/// Text in the style of all figures; (x, y) is its left base point.
void drawText(cv::Mat& canvas, const std::string& text, const cv::Point& at, double scale) {
  cv::putText(canvas, text, at, cv::FONT_HERSHEY_SIMPLEX, scale, kInk, 1, cv::LINE_AA);
}

/// 1, 2 or 5 times a power of ten: at most eight of them along an axis.
double roundStep(const Axis& values) {
  const double raw = values.length() / 8;
  const double power = std::pow(10.0, std::floor(std::log10(raw)));
  for (const double factor : {1.0, 2.0, 5.0}) {
    if (factor * power >= raw) return factor * power;
  }
  return 10 * power;
}

/// Calls f with the multiples of a step inside of an axis, their subpixel and their text.
template <typename F>
void forEachTick(const Axis& axis, double step, const F& f) {
  constexpr double kTolerance = 1e-6;  // share of a step; keeps ends that are ticks
  const auto first = std::lround(std::ceil(axis.low / step - kTolerance));
  const auto last = std::lround(std::floor(axis.high / step + kTolerance));
  for (auto i = first; i <= last; ++i) {
    const double value = static_cast<double>(i) * step;
    f(axis.subpixel(value), fmt::format("{:.6g}", value));
  }
}

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
  std::vector<cv::Point2d> frames;
  std::vector<cv::Point2d> keyframes;
};

/// Segments with the most frames, in the order of the sequence.
std::vector<SegmentPath> longestPaths(const RunRecord& record) {
  std::map<int, SegmentPath> all;
  const auto add = [&](const Entries& entries, std::vector<cv::Point2d> SegmentPath::*points) {
    for (const PosedEntry& entry : entries) {
      const Eigen::Vector3d place = record.T_world_cam(entry).translation();
      (all[record.segmentOf(entry)].*points).emplace_back(place.x(), place.z());
    }
  };
  add(record.frames(), &SegmentPath::frames);
  add(record.keyframes(), &SegmentPath::keyframes);
  std::vector<SegmentPath> paths;
  for (auto& [segment, path] : all) {
    path.segment = segment;
    if (!path.frames.empty()) paths.push_back(std::move(path));
  }
  const auto longer = [](const auto& a, const auto& b) {
    return a.frames.size() > b.frames.size();
  };
  std::stable_sort(paths.begin(), paths.end(), longer);
  paths.resize(std::min(paths.size(), kMaxPanels));
  std::sort(paths.begin(), paths.end(), [](const auto& a, const auto& b) {
    return a.segment < b.segment;
  });
  return paths;
}

/// Grid and numbers, a step apart on both axes.
void drawGrid(cv::Mat& canvas, const Axis& x, const Axis& z, double step) {
  const auto draw = [&](const cv::Point& from, const cv::Point& to) {
    cv::line(canvas, from, to, kGrid, 1, cv::LINE_AA, kSubpixelBits);
    return cv::Point(from.x >> kSubpixelBits, from.y >> kSubpixelBits);
  };
  forEachTick(x, step, [&](int at, const std::string& text) {
    const cv::Point base = draw({at, z.subpixel(z.low)}, {at, z.subpixel(z.high)});
    drawText(canvas, text, base + cv::Point(-4 * static_cast<int>(text.size()), 16), 0.4);
  });
  forEachTick(z, step, [&](int at, const std::string& text) {
    const cv::Point base = draw({x.subpixel(x.low), at}, {x.subpixel(x.high), at});
    drawText(canvas, text, base + cv::Point(-8 - 8 * static_cast<int>(text.size()), 4), 0.4);
  });
}

/// @param metric whether the path is told in metres
void drawPath(cv::Mat& canvas, const cv::Rect& area, const SegmentPath& path, bool metric) {
  const cv::Rect plot(area.x + kLeftMargin,
                      area.y + kTopMargin,
                      area.width - kLeftMargin - kRightMargin,
                      area.height - kTopMargin - kBottomMargin);
  // The origin, the reference camera, is always in view.
  Axis x{plot.x, plot.x + plot.width - 1};
  Axis z{plot.y + plot.height - 1, plot.y};
  for (const cv::Point2d& point : path.frames) {
    x.include(point.x);
    z.include(point.y);
  }
  // One unit is equally long on both axes.
  const double per_pixel =
      1.1 * std::max({x.length() / plot.width, z.length() / plot.height, 1e-6});
  x.widenTo(per_pixel * plot.width);
  z.widenTo(per_pixel * plot.height);
  drawText(canvas,
           fmt::format("segment {}: {} frames (blue), {} keyframes (red), start green",
                       path.segment,
                       path.frames.size(),
                       path.keyframes.size()),
           {plot.x, plot.y - 10},
           0.5);
  drawGrid(canvas, x, z, std::max(roundStep(x), roundStep(z)));
  cv::rectangle(canvas, plot, kInk, 1);
  drawText(canvas,
           metric ? "x right, z up [m]"
                  : "x right, z up; unit: mean inverse depth of the reference is 1",
           {plot.x, plot.y + plot.height + 36},
           0.42);
  const auto pixel = [&](const cv::Point2d& point) {
    return cv::Point(x.subpixel(point.x), z.subpixel(point.y));
  };
  const auto dot = [&](const cv::Point2d& point, int radius, const cv::Scalar& colour) {
    const int size = radius << kSubpixelBits;
    cv::circle(canvas, pixel(point), size, colour, cv::FILLED, cv::LINE_AA, kSubpixelBits);
  };
  std::vector<cv::Point> pixels;
  pixels.reserve(path.frames.size());
  for (const cv::Point2d& point : path.frames) pixels.push_back(pixel(point));
  cv::polylines(canvas, pixels, false, kPathColour, 2, cv::LINE_AA, kSubpixelBits);
  for (const cv::Point2d& point : path.keyframes) dot(point, 4, kKeyframeColour);
  dot({0, 0}, 5, kStartColour);
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
    const cv::Point corner(column * panel.width, row * panel.height);
    drawPath(canvas, {corner, panel}, paths[i], record.unitOf(paths[i].segment).has_value());
  }
  if (paths.empty()) drawText(canvas, "never initialized", {40, 60}, 0.6);
  return canvas;
}

void writePng(const std::filesystem::path& path, const cv::Mat& image) {
  const int type = image.type();
  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  png.width = static_cast<png_uint_32>(image.cols);
  png.height = static_cast<png_uint_32>(image.rows);
  png.format = type == CV_16UC1  ? PNG_FORMAT_LINEAR_Y
               : type == CV_8UC3 ? PNG_FORMAT_BGR
                                 : PNG_FORMAT_GRAY;
  png.flags = PNG_IMAGE_FLAG_FAST;
  png_alloc_size_t size = PNG_IMAGE_PNG_SIZE_MAX(png);
  std::string bytes(size, '\0');
  const auto row = static_cast<png_int_32>(image.step / image.elemSize1());
  if (png_image_write_to_memory(&png, bytes.data(), &size, 0, image.data, row, nullptr) == 0) {
    throw std::runtime_error(fmt::format("libpng: {}", static_cast<const char*>(png.message)));
  }
  replaceFile(path, std::string_view(bytes).substr(0, size));
}

}  // namespace dsorb::io
