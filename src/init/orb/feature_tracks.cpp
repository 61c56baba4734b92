// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/feature_tracks.h"

#include "base/parallel.h"
#include "init/orb/grey_image.h"
#include "init/orb/image_scale.h"

#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

namespace dsorb::init_orb {
namespace {

constexpr std::size_t kTrackGrain = 64;  // tracks one thread follows at a time
constexpr float kLostMiss = 1e6F;        // [px]; of a track that was not found

/// Corners of an image, well inside it, spread over it and away from those that are there already.
class CornerGrid {
 public:
  CornerGrid(cv::Size size, const FeatureTrackOptions& options)
      : size_(size),
        options_(options),
        columns_((size.width + options.cell_size - 1) / options.cell_size),
        min_distance_(options.min_distance * imageScale(size.width, size.height)) {
    const int rows = (size.height + options.cell_size - 1) / options.cell_size;
    taken_.resize(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows), 0);
    // Twice an even share: cells without texture leave theirs to others.
    const auto cells = static_cast<int>(taken_.size());
    cap_ = std::max(1, (2 * options.max_corners + cells - 1) / cells);
  }

  /// The strongest corners of every cell, so that a textured part of the image cannot take all.
  /// @param known places that are taken
  [[nodiscard]] std::vector<Eigen::Vector2f> choose(const cv::Mat& grey,
                                                    const cv::Mat& valid,
                                                    const std::vector<Eigen::Vector2f>& known) {
    std::vector<cv::Point2f> corners;
    cv::goodFeaturesToTrack(grey, corners, 0, options_.corner_quality, min_distance_, valid);
    cv::Mat occupied;
    if (!known.empty()) occupied = cv::Mat::zeros(size_, CV_8UC1);
    for (const Eigen::Vector2f& place : known) {
      ++taken(place.x(), place.y());
      const cv::Point centre(cvRound(place.x()), cvRound(place.y()));
      cv::circle(occupied, centre, static_cast<int>(min_distance_), cv::Scalar(1), cv::FILLED);
    }
    const std::size_t wanted =
        static_cast<std::size_t>(options_.max_corners) -
        std::min(known.size(), static_cast<std::size_t>(options_.max_corners));
    std::vector<Eigen::Vector2f> chosen;
    for (const cv::Point2f& corner : corners) {
      if (chosen.size() == wanted) break;
      if (!isInside(corner) || (!occupied.empty() && occupied.at<std::uint8_t>(corner) != 0)) {
        continue;
      }
      if (taken(corner.x, corner.y)++ < cap_) chosen.emplace_back(corner.x, corner.y);
    }
    return chosen;
  }

 private:
  [[nodiscard]] bool isInside(const cv::Point2f& corner) const {
    return corner.x >= kFeatureBorder && corner.y >= kFeatureBorder &&
           corner.x <= static_cast<float>(size_.width - 1 - kFeatureBorder) &&
           corner.y <= static_cast<float>(size_.height - 1 - kFeatureBorder);
  }
  int& taken(float x, float y) {
    const int cell = static_cast<int>(y) / options_.cell_size * columns_ +
                     static_cast<int>(x) / options_.cell_size;
    return taken_[static_cast<std::size_t>(cell)];
  }

  cv::Size size_;
  const FeatureTrackOptions& options_;
  int columns_;
  double min_distance_;  // [px] in this image
  int cap_ = 1;
  std::vector<int> taken_;  // corners by cell
};

/// Where a step of Lucas-Kanade ended.
struct StepEnds {
  std::vector<cv::Point2f> place;
  std::vector<float> miss;  // of the start, after going back again [px]
};

/// Lucas-Kanade between two images.
struct LucasKanade {
  explicit LucasKanade(const FeatureTrackOptions& options)
      : window(options.window, options.window),
        max_level(options.max_level),
        stop(cv::TermCriteria::COUNT + cv::TermCriteria::EPS,
             options.max_iterations,
             options.min_step) {}

  void pyramid(const cv::Mat& grey, std::vector<cv::Mat>& levels) const {
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
  [[nodiscard]] StepEnds followBothWays(const std::vector<cv::Mat>& from,
                                        const std::vector<cv::Mat>& to,
                                        const Eigen::Vector2f* places,
                                        std::size_t count) const {
    std::vector<cv::Point2f> start;
    start.reserve(count);
    for (std::size_t i = 0; i < count; ++i) start.emplace_back(places[i].x(), places[i].y());
    StepEnds ends;
    std::vector<cv::Point2f> back;
    std::vector<unsigned char> found;
    std::vector<unsigned char> found_back;
    follow(from, to, start, ends.place, found);
    follow(to, from, ends.place, back, found_back);
    for (std::size_t i = 0; i < count; ++i) {
      const cv::Point2f miss = back[i] - start[i];
      ends.miss.push_back(found[i] != 0 && found_back[i] != 0 ? std::hypot(miss.x, miss.y)
                                                              : kLostMiss);
    }
    return ends;
  }

  cv::Size window;
  int max_level;
  cv::TermCriteria stop;
};

}  // namespace

void FeatureTracks::clear() {
  positions_.clear();
  births_.clear();
  survivor_share_ = 1;
}

void FeatureTracks::start(const Frame& reference) {
  clear();
  GreyImage image = greyImage(reference.level(0), 1.0F, options_.window / 2);
  grey_ = std::move(image.grey);
  valid_ = std::move(image.valid);
  reference_mean_ = meanIntensity(reference);
  LucasKanade(options_).pyramid(grey_, pyramid_);
  positions_.emplace_back();
  addCorners();
}

void FeatureTracks::addCorners() {
  const std::vector<Eigen::Vector2f> fresh =
      CornerGrid(grey_.size(), options_).choose(grey_, valid_, positions_.back());
  const std::size_t tracks = births_.size() + fresh.size();
  for (auto& frame : positions_) frame.resize(tracks, Eigen::Vector2f::Constant(NAN));
  std::copy(fresh.begin(),
            fresh.end(),
            positions_.back().begin() + static_cast<std::ptrdiff_t>(births_.size()));
  births_.resize(tracks, frames() - 1);
}

void FeatureTracks::advance(const Frame& frame) {
  const GreyImage image =
      greyImage(frame.level(0), gainTowards(reference_mean_, frame), options_.window / 2);
  const LucasKanade lucas_kanade(options_);
  std::swap(pyramid_, other_pyramid_);
  lucas_kanade.pyramid(image.grey, pyramid_);

  const std::vector<Eigen::Vector2f>& before = positions_.back();
  std::vector<Eigen::Vector2f> after(before.size());
  std::vector<char> alive(before.size(), 0);
  forEachRange(before.size(), kTrackGrain, [&](std::size_t begin, std::size_t end) {
    const StepEnds ends =
        lucas_kanade.followBothWays(other_pyramid_, pyramid_, &before[begin], end - begin);
    for (std::size_t i = begin; i < end; ++i) {
      const cv::Point2f& place = ends.place[i - begin];
      const bool kept = ends.miss[i - begin] < options_.max_backward_error && image.usable(place);
      alive[i] = kept ? 1 : 0;
      after[i] = {place.x, place.y};
    }
  });
  positions_.push_back(std::move(after));
  grey_ = image.grey;
  valid_ = image.valid;
  keepOnly(alive);
}

void FeatureTracks::keepOnly(const std::vector<char>& alive) {
  std::size_t kept = 0;
  for (std::size_t i = 0; i < alive.size(); ++i) {
    if (alive[i] == 0) continue;
    for (auto& frame : positions_) frame[kept] = frame[i];
    births_[kept++] = births_[i];
  }
  for (auto& frame : positions_) frame.resize(kept);
  births_.resize(kept);
  survivor_share_ =
      alive.empty() ? 1.0 : static_cast<double>(kept) / static_cast<double>(alive.size());
}

void FeatureTracks::dropFrames(int count) {
  positions_.erase(positions_.begin(), positions_.begin() + count);
  for (int& birth : births_) birth = std::max(0, birth - count);
}

int FeatureTracks::sizeSince(int frame) const {
  return static_cast<int>(std::upper_bound(births_.begin(), births_.end(), frame) -
                          births_.begin());
}

CornerTracks FeatureTracks::since(int reference) const {
  CornerTracks tracks;
  for (auto frame = positions_.begin() + reference; frame != positions_.end(); ++frame) {
    tracks.positions.emplace_back(frame->begin(), frame->begin() + sizeSince(reference));
  }
  return tracks;
}

}  // namespace dsorb::init_orb
