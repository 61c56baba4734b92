// SPDX-License-Identifier: BSD-3-Clause
#include "io/output/figures.h"

#include "dsorb/error.h"

#include "base/median.h"
#include "io/output/output_file.h"

#include <fmt/format.h>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <png.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

namespace dsorb::io {
namespace {

constexpr int kSubpixelBits = 4;  // of OpenCV's drawing functions
constexpr int kBarWidth = 90;
constexpr double kMaxFigureWidth = 1600;  // [px]
constexpr int kFirstColour = 26;
constexpr int kLastColour = 240;
const cv::Scalar kInk(60, 60, 60);
const cv::Scalar kGrid(225, 225, 225);
const cv::Scalar kPathColour(180, 110, 30);
const cv::Scalar kKeyframeColour(40, 40, 220);
const cv::Scalar kStartColour(60, 160, 40);

/// Text in the style of all figures; (x, y) is its left base point.
void drawText(cv::Mat& canvas, const std::string& text, const cv::Point& at, double scale) {
  cv::putText(canvas, text, at, cv::FONT_HERSHEY_SIMPLEX, scale, kInk, 1, cv::LINE_AA);
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
  const int top = 24;
  if (canvas.rows <= 2 * top) return;
  const cv::Rect bar(canvas.cols - kBarWidth + 10, top, 16, canvas.rows - 2 * top);
  cv::Mat ramp;
  cv::rotate(colours, ramp, cv::ROTATE_90_COUNTERCLOCKWISE);
  cv::resize(ramp, canvas(bar), bar.size(), 0, 0, cv::INTER_NEAREST);
  for (int i = 0; i <= 4; ++i) {
    const float value = high + (low - high) * static_cast<float>(i) / 4;
    drawText(canvas,
             fmt::format("{:.2f}", static_cast<double>(value)),
             {bar.x + 22, top + 5 + (bar.height - 1) * i / 4},
             0.4);
  }
  drawText(canvas, "1/depth", {bar.x, 14}, 0.4);
}

/// Places of one segment's entries seen from above: x to the right, z up.
std::vector<cv::Point2d> seenFromAbove(const RunRecord& record,
                                       const Entries& entries,
                                       int segment) {
  std::vector<cv::Point2d> places;
  for (const PosedEntry& entry : entries) {
    if (record.segmentOf(entry) != segment) continue;
    const Eigen::Vector3d place = record.T_world_cam(entry).translation();
    places.emplace_back(place.x(), -place.z());
  }
  return places;
}

/// 1, 2 or 5 times a power of ten, at most eight of which lie within a length.
double gridStep(double length) {
  const double power = std::pow(10.0, std::floor(std::log10(length / 8)));
  for (const double factor : {1.0, 2.0, 5.0}) {
    if (8 * factor * power >= length) return factor * power;
  }
  return 10 * power;
}

}  // namespace

cv::Mat greyImage(const Frame& frame) {
  cv::Mat grey(frame.height(), frame.width(), CV_8UC1);
  grey.forEach<uchar>([&](uchar& pixel, const int* at) {
    const float value = frame.level(0).at(at[1], at[0]).intensity;
    pixel = std::isfinite(value) ? cv::saturate_cast<uchar>(value) : uchar{0};
  });
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
  const float low = quantileInPlace(values, 0.02);
  const float high = std::max(quantileInPlace(values, 0.98), low + 1e-6F);

  const double scale = std::min(1.0, kMaxFigureWidth / reference.width());
  cv::Mat grey = greyImage(reference);
  if (scale < 1) cv::resize(grey, grey, {}, scale, scale, cv::INTER_AREA);
  cv::Mat canvas(grey.rows, grey.cols + kBarWidth, CV_8UC3, cv::Scalar::all(255));
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
  constexpr int kSide = 800;   // [px]
  constexpr int kMargin = 40;  // [px]
  cv::Mat canvas(kSide, kSide, CV_8UC3, cv::Scalar::all(255));
  const int segment = record.longestSegment();
  const auto frames = seenFromAbove(record, record.frames(), segment);
  const auto keyframes = seenFromAbove(record, record.keyframes(), segment);
  if (frames.empty()) {
    drawText(canvas, "never initialized", {kMargin, kMargin}, 0.6);
    return canvas;
  }
  cv::Point2d low;  // the origin, the reference camera, is always in view
  cv::Point2d high;
  for (const cv::Point2d& place : frames) {
    low = {std::min(low.x, place.x), std::min(low.y, place.y)};
    high = {std::max(high.x, place.x), std::max(high.y, place.y)};
  }
  const double length = std::max({high.x - low.x, high.y - low.y, 1e-3});
  const cv::Point2d centre = (low + high) / 2;
  const auto pixel = [&](const cv::Point2d& place) {
    const cv::Point2d at = (place - centre) * ((kSide - 2 * kMargin) / length);
    return cv::Point((at + cv::Point2d(kSide, kSide) / 2) * (1 << kSubpixelBits));
  };
  const double step = gridStep(length);
  const auto lines = static_cast<int>(std::max(cv::norm(low), cv::norm(high)) / step) + 1;
  for (int i = -lines; i <= lines; ++i) {
    const cv::Point at = pixel({i * step, i * step}) / (1 << kSubpixelBits);
    cv::line(canvas, {at.x, 0}, {at.x, kSide}, kGrid);
    cv::line(canvas, {0, at.y}, {kSide, at.y}, kGrid);
  }
  const auto dot = [&](const cv::Point2d& place, int radius, const cv::Scalar& colour) {
    const int size = radius << kSubpixelBits;
    cv::circle(canvas, pixel(place), size, colour, cv::FILLED, cv::LINE_AA, kSubpixelBits);
  };
  std::vector<cv::Point> path;
  path.reserve(frames.size());
  for (const cv::Point2d& place : frames) path.push_back(pixel(place));
  cv::polylines(canvas, path, false, kPathColour, 2, cv::LINE_AA, kSubpixelBits);
  for (const cv::Point2d& place : keyframes) dot(place, 4, kKeyframeColour);
  dot({0, 0}, 5, kStartColour);
  drawText(canvas,
           fmt::format("segment {}: {} frames (blue), {} keyframes (red), start green; "
                       "x right, z up, grid {:g}{}",
                       segment,
                       frames.size(),
                       keyframes.size(),
                       step,
                       record.unitOf(segment) ? " m" : ""),
           {kMargin / 2, kMargin / 2},
           0.45);
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
