// SPDX-License-Identifier: BSD-3-Clause
#include "features/grey_image.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace dsorb {
namespace {

constexpr std::uint8_t kValid = 255;
constexpr double kMaxGain = 4;
constexpr int kBrightnessLevel = 2;  // small enough to average quickly

}  // namespace

double meanIntensity(const Frame& frame) {
  const PyramidLevel& level = frame.level(std::min(kBrightnessLevel, frame.pyramid().levels() - 1));
  double sum = 0;
  int count = 0;
  for (int y = 0; y < level.height(); ++y) {
    const float* row = level.row(y);
    for (int x = 0; x < level.width(); ++x) {
      if (!std::isfinite(row[x])) continue;
      sum += row[x];
      ++count;
    }
  }
  return count > 0 ? sum / count : 0;
}

float gainTowards(double mean_intensity, const Frame& frame) {
  const double mean = meanIntensity(frame);
  return mean > 0 ? static_cast<float>(std::clamp(mean_intensity / mean, 1 / kMaxGain, kMaxGain))
                  : 1.0F;
}

cv::Mat validMask(const PyramidLevel& level, int margin) {
  cv::Mat valid(level.height(), level.width(), CV_8UC1);
  for (int y = 0; y < level.height(); ++y) {
    const float* source = level.row(y);
    auto* row = valid.ptr<std::uint8_t>(y);
    for (int x = 0; x < level.width(); ++x) {
      row[x] = std::isfinite(source[x]) ? kValid : 0;
    }
  }
  cv::erode(valid, valid, cv::Mat::ones(2 * margin + 1, 2 * margin + 1, CV_8UC1));
  return valid;
}

GreyImage greyImage(const PyramidLevel& level, float gain, int margin) {
  GreyImage image{cv::Mat(level.height(), level.width(), CV_8UC1), {}};
  bool all_valid = true;
  for (int y = 0; y < level.height(); ++y) {
    const float* source = level.row(y);
    auto* grey = image.grey.ptr<std::uint8_t>(y);
    for (int x = 0; x < level.width(); ++x) {
      const float intensity = source[x];
      const bool valid = std::isfinite(intensity);
      grey[x] = valid ? cv::saturate_cast<std::uint8_t>(gain * intensity) : std::uint8_t{0};
      all_valid = all_valid && valid;
    }
  }
  if (!all_valid) image.valid = validMask(level, margin);
  return image;
}

bool isUsable(const Eigen::Vector2f& position, cv::Size size, const cv::Mat& valid) {
  if (!(position.x() >= kFeatureBorder && position.y() >= kFeatureBorder &&
        position.x() <= static_cast<float>(size.width - 1 - kFeatureBorder) &&
        position.y() <= static_cast<float>(size.height - 1 - kFeatureBorder))) {
    return false;
  }
  return valid.empty() ||
         valid.at<std::uint8_t>(cvRound(position.y()), cvRound(position.x())) == kValid;
}

bool GreyImage::usable(const cv::Point2f& position) const {
  return isUsable({position.x, position.y}, grey.size(), valid);
}

}  // namespace dsorb
