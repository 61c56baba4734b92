// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/feature_tracks.h"

#include "image/photometric.h"

#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace dsorb::init_orb {
namespace {

constexpr double kReferenceDiagonal = 800;   // [px] of 640x480, where min_distance is meant
constexpr int kBorder = kPatternRadius + 1;  // [px]; the pattern and its interpolation stay inside
constexpr std::uint8_t kValid = 255;
constexpr double kMaxGain = 4;  // two stops; more is another scene or an image without content

/// What OpenCV sees of a frame.
struct GreyImage {
  cv::Mat grey;   // 8 bit, invalid pixels black
  cv::Mat valid;  // 255 where the pixel and all neighbours of the Lucas-Kanade window are valid;
                  // empty when the whole image is
};

/// Mean intensity of the valid pixels [grey levels]; 0 without any.
double meanIntensity(const PyramidLevel& level) {
  double sum = 0;
  int count = 0;
  for (int y = 0; y < level.height(); ++y) {
    const ImageSample* row = level.row(y);
    for (int x = 0; x < level.width(); ++x) {
      if (!std::isfinite(row[x].intensity)) continue;
      sum += row[x].intensity;
      ++count;
    }
  }
  return count > 0 ? sum / count : 0;
}

/// Level that is small enough to average quickly.
int brightnessLevel(const Frame& frame) {
  return std::min(2, frame.pyramid().levels() - 1);
}

/// @param gain   applied to the intensities; Lucas-Kanade expects equal brightness
/// @param margin by which invalid regions are widened [px]
GreyImage greyImage(const PyramidLevel& level, float gain, int margin) {
  GreyImage image{cv::Mat(level.height(), level.width(), CV_8UC1), {}};
  for (int y = 0; y < level.height(); ++y) {
    const ImageSample* source = level.row(y);
    auto* grey = image.grey.ptr<std::uint8_t>(y);
    for (int x = 0; x < level.width(); ++x) {
      const float intensity = source[x].intensity;
      if (std::isfinite(intensity)) {
        grey[x] = cv::saturate_cast<std::uint8_t>(gain * intensity);
        continue;
      }
      grey[x] = 0;
      if (image.valid.empty())
        image.valid = cv::Mat(image.grey.size(), CV_8UC1, cv::Scalar(kValid));
      image.valid.at<std::uint8_t>(y, x) = 0;
    }
  }
  if (!image.valid.empty()) {
    const cv::Mat square = cv::Mat::ones(2 * margin + 1, 2 * margin + 1, CV_8UC1);
    cv::erode(image.valid, image.valid, square);
  }
  return image;
}

/// Keeps the strongest corners of every grid cell, so that a textured corner of the image cannot
/// take all. @param corners strongest first
std::vector<Eigen::Vector2f> spread(const std::vector<cv::Point2f>& corners,
                                    cv::Size size,
                                    const FeatureTrackOptions& options) {
  const int columns = (size.width + options.cell_size - 1) / options.cell_size;
  const int rows = (size.height + options.cell_size - 1) / options.cell_size;
  const int cells = columns * rows;
  // Twice an even share: cells without texture leave theirs to others.
  const int cap = std::max(1, (2 * options.max_corners + cells - 1) / cells);
  std::vector<int> taken(static_cast<std::size_t>(cells), 0);
  std::vector<Eigen::Vector2f> kept;
  for (const cv::Point2f& corner : corners) {
    if (corner.x < kBorder || corner.y < kBorder ||
        corner.x > static_cast<float>(size.width - 1 - kBorder) ||
        corner.y > static_cast<float>(size.height - 1 - kBorder)) {
      continue;
    }
    const int cell = static_cast<int>(corner.y) / options.cell_size * columns +
                     static_cast<int>(corner.x) / options.cell_size;
    if (taken[static_cast<std::size_t>(cell)]++ >= cap) continue;
    kept.emplace_back(corner.x, corner.y);
    if (static_cast<int>(kept.size()) == options.max_corners) break;
  }
  return kept;
}

bool usable(const GreyImage& image, const cv::Point2f& position) {
  if (!(position.x >= kBorder && position.y >= kBorder &&
        position.x <= static_cast<float>(image.grey.cols - 1 - kBorder) &&
        position.y <= static_cast<float>(image.grey.rows - 1 - kBorder))) {
    return false;
  }
  return image.valid.empty() ||
         image.valid.at<std::uint8_t>(cvRound(position.y), cvRound(position.x)) == kValid;
}

/// One call of Lucas-Kanade between two images.
struct LucasKanade {
  explicit LucasKanade(const FeatureTrackOptions& options)
      : window(options.window, options.window),
        max_level(options.max_level),
        stop(cv::TermCriteria::COUNT + cv::TermCriteria::EPS,
             options.max_iterations,
             options.min_step) {}

  void pyramid(const cv::Mat& grey, std::vector<cv::Mat>& levels) const {
    levels.clear();
    cv::buildOpticalFlowPyramid(grey, levels, window, max_level, true);
  }
  void follow(const std::vector<cv::Mat>& from,
              const std::vector<cv::Mat>& to,
              const std::vector<cv::Point2f>& start,
              std::vector<cv::Point2f>& end,
              std::vector<unsigned char>& found) const {
    cv::Mat error;
    cv::calcOpticalFlowPyrLK(from, to, start, end, found, error, window, max_level, stop);
  }

  cv::Size window;
  int max_level;
  cv::TermCriteria stop;
};

}  // namespace

void FeatureTracks::clear() {
  positions_.clear();
  previous_pyramid_.clear();
  survivor_share_ = 1;
}

void FeatureTracks::start(const Frame& reference) {
  clear();
  const GreyImage image = greyImage(reference.level(0), 1.0F, options_.window / 2);
  const double diagonal = std::hypot(image.grey.cols, image.grey.rows);
  const double min_distance = options_.min_distance * diagonal / kReferenceDiagonal;
  std::vector<cv::Point2f> corners;
  cv::goodFeaturesToTrack(
      image.grey, corners, 0, options_.corner_quality, min_distance, image.valid);
  positions_.push_back(spread(corners, image.grey.size(), options_));
  LucasKanade(options_).pyramid(image.grey, previous_pyramid_);
  reference_mean_ = meanIntensity(reference.level(brightnessLevel(reference)));
}

void FeatureTracks::advance(const Frame& frame) {
  const LucasKanade lucas_kanade(options_);
  const double mean = meanIntensity(frame.level(brightnessLevel(frame)));
  const double gain = mean > 0 ? std::clamp(reference_mean_ / mean, 1 / kMaxGain, kMaxGain) : 1.0;
  const GreyImage image = greyImage(frame.level(0), static_cast<float>(gain), options_.window / 2);
  std::vector<cv::Mat> pyramid;
  lucas_kanade.pyramid(image.grey, pyramid);

  const std::vector<Eigen::Vector2f>& before = positions_.back();
  std::vector<Eigen::Vector2f> after(before.size());
  std::vector<char> alive(before.size(), 0);
  if (!before.empty()) {
    std::vector<cv::Point2f> start;
    start.reserve(before.size());
    for (const Eigen::Vector2f& p : before) start.emplace_back(p.x(), p.y());
    std::vector<cv::Point2f> forward;
    std::vector<cv::Point2f> backward;
    std::vector<unsigned char> found_forward;
    std::vector<unsigned char> found_backward;
    lucas_kanade.follow(previous_pyramid_, pyramid, start, forward, found_forward);
    lucas_kanade.follow(pyramid, previous_pyramid_, forward, backward, found_backward);
    for (std::size_t i = 0; i < before.size(); ++i) {
      const cv::Point2f miss = backward[i] - start[i];
      const bool returned = std::hypot(miss.x, miss.y) < options_.max_backward_error;
      alive[i] =
          found_forward[i] != 0 && found_backward[i] != 0 && returned && usable(image, forward[i]);
      after[i] = {forward[i].x, forward[i].y};
    }
  }
  positions_.push_back(std::move(after));
  previous_pyramid_ = std::move(pyramid);
  keepOnly(alive);
}

void FeatureTracks::keepOnly(const std::vector<char>& alive) {
  std::size_t kept = 0;
  for (std::size_t i = 0; i < alive.size(); ++i) {
    if (alive[i] == 0) continue;
    for (auto& frame : positions_) frame[kept] = frame[i];
    ++kept;
  }
  for (auto& frame : positions_) frame.resize(kept);
  survivor_share_ =
      alive.empty() ? 1.0 : static_cast<double>(kept) / static_cast<double>(alive.size());
}

}  // namespace dsorb::init_orb
