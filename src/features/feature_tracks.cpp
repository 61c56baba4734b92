// SPDX-License-Identifier: BSD-3-Clause
#include "features/feature_tracks.h"

#include "base/erase_marked.h"
#include "base/parallel.h"
#include "features/grey_image.h"
#include "image/cell_grid.h"
#include "image/image_scale.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

namespace dsorb {
namespace {

constexpr double kMinDistance = 8;  // between corners, for an image diagonal of 800 px [px]

LucasKanadeOptions flowOptions(const FeatureTrackOptions& options) {
  return {options.max_level, options.min_eigenvalue};
}

/// Level 0 of a pyramid as OpenCV wants it.
cv::Mat eightBit(const FlowLevel& level) {
  const cv::Mat values(level.height,
                       level.width,
                       CV_32FC1,
                       const_cast<float*>(level.row(0)),  // cv::Mat has no view of const
                       static_cast<std::size_t>(level.stride) * sizeof(float));
  cv::Mat grey;
  values.convertTo(grey, CV_8U);
  return grey;
}

}  // namespace

std::vector<Eigen::Vector2f> chooseCorners(const cv::Mat& grey,
                                           const cv::Mat& valid,
                                           const std::vector<Eigen::Vector2f>& known,
                                           const FeatureTrackOptions& options) {
  const cv::Size size = grey.size();
  const double min_distance = kMinDistance * imageScale(size.width, size.height);
  SpacedPlaces spaced(size.width, size.height, static_cast<float>(min_distance));
  CellQuota quota(CellGrid(size.width, size.height, kSpreadCell), options.max_corners);
  for (const Eigen::Vector2f& place : known) {
    quota.take(place.x(), place.y());
    spaced.add(place);
  }
  const auto most = static_cast<std::size_t>(options.max_corners);
  const std::size_t wanted = most - std::min(known.size(), most);
  std::vector<cv::Point2f> strongest_first;
  cv::goodFeaturesToTrack(grey, strongest_first, 0, options.corner_quality, 0, valid);
  std::vector<Eigen::Vector2f> chosen;
  for (const cv::Point2f& corner : strongest_first) {
    if (chosen.size() == wanted) break;
    const Eigen::Vector2f place(corner.x, corner.y);
    if (spaced.take(place) && isUsable(place, size, valid) && quota.take(place.x(), place.y())) {
      chosen.push_back(place);
    }
  }
  return chosen;
}

void FeatureTracks::clear() {
  positions_.clear();
  births_.clear();
  survivor_share_ = 1;
}

void FeatureTracks::start(const Frame& reference) {
  clear();
  reference_mean_ = meanIntensity(reference);
  show(reference, 1.0F);
  positions_.emplace_back();
  addCorners();
}

void FeatureTracks::show(const Frame& frame, float gain) {
  const bool all_valid = pyramid_.build(frame.level(0), gain, flowOptions(options_));
  valid_ = all_valid ? cv::Mat() : validMask(frame.level(0), kFlowWindow / 2);
}

void FeatureTracks::addCorners() {
  const FlowLevel& image = pyramid_.levels().front();
  const std::vector<Eigen::Vector2f> fresh =
      chooseCorners(eightBit(image), valid_, positions_.back(), options_);
  const std::size_t tracks = births_.size() + fresh.size();
  for (auto& frame : positions_) frame.resize(tracks, Eigen::Vector2f::Constant(NAN));
  std::copy(fresh.begin(),
            fresh.end(),
            positions_.back().begin() + static_cast<std::ptrdiff_t>(births_.size()));
  births_.resize(tracks, frames() - 1);
}

void FeatureTracks::advance(const Frame& frame) {
  std::swap(pyramid_, other_pyramid_);
  show(frame, gainTowards(reference_mean_, frame));
  const std::vector<Eigen::Vector2f>& before = positions_.back();
  const cv::Size size(frame.width(), frame.height());
  std::vector<Eigen::Vector2f> after = before;
  std::vector<char> lost(before.size(), 1);
  forEachRange(before.size(), kTaskGrain, [&](std::size_t begin, std::size_t end) {
    LucasKanade flow(flowOptions(options_));
    for (std::size_t i = begin; i < end; ++i) {
      if (!flow.follow(other_pyramid_, pyramid_, after[i])) continue;
      Eigen::Vector2f back = after[i];
      const bool returns = isUsable(after[i], size, valid_) &&
                           flow.follow(pyramid_, other_pyramid_, back) &&
                           (back - before[i]).norm() < kMaxBackwardError;
      lost[i] = returns ? 0 : 1;
    }
  });
  positions_.push_back(std::move(after));
  drop(lost);
}

void FeatureTracks::drop(const std::vector<char>& lost) {
  for (auto& frame : positions_) eraseMarked(lost, frame);
  eraseMarked(lost, births_);
  survivor_share_ =
      lost.empty() ? 1.0 : static_cast<double>(births_.size()) / static_cast<double>(lost.size());
}

void FeatureTracks::dropFrames(int first, int count) {
  const auto begin = positions_.begin() + first;
  positions_.erase(begin, begin + count);
  for (int& birth : births_) {
    if (birth > first) birth = std::max(first, birth - count);
  }
}

int FeatureTracks::sizeSince(int frame) const {
  return static_cast<int>(std::upper_bound(births_.begin(), births_.end(), frame) -
                          births_.begin());
}

Matches FeatureTracks::matchesFrom(int reference) const {
  CornerTracks ends;
  for (const auto* frame : {&positions_[static_cast<std::size_t>(reference)], &positions_.back()}) {
    ends.positions.emplace_back(frame->begin(), frame->begin() + sizeSince(reference));
  }
  return ends.matchesTo(1);
}

CornerTracks FeatureTracks::since(int reference) const {
  CornerTracks tracks;
  for (auto frame = positions_.begin() + reference; frame != positions_.end(); ++frame) {
    tracks.positions.emplace_back(frame->begin(), frame->begin() + sizeSince(reference));
  }
  return tracks;
}

}  // namespace dsorb
