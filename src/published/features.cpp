// SPDX-License-Identifier: BSD-3-Clause
#include "published/features.h"

#include "features/feature_matches.h"
#include "image/cell_grid.h"
#include "image/image_scale.h"
#include "init/waiting_frames.h"

#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>

#include <algorithm>
#include <cmath>
#include <utility>

namespace dsorb::published {
namespace {

using Places = std::vector<Eigen::Vector2f>;

constexpr double kCornerQuality = 0.01;  // strength relative to the strongest of the image
constexpr double kMinDistance = 8;       // between corners, for an image diagonal of 800 px [px]
constexpr int kWindow = 21;              // side of the patch that Lucas-Kanade aligns [px]
constexpr int kMaxLevel = 3;             // of its pyramid
constexpr int kMaxSteps = 30;            // on each level
constexpr double kMinStep = 0.01;        // a smaller one is the last [px of the level]
constexpr double kMinEigenvalue = 0.1 / 1024;  // of a patch; OpenCV's default is 1e-4
constexpr float kMaxBackwardError = 1;         // forward and backward again may miss the start [px]
constexpr double kMinSurvivorShare = 0.2;      // of tracks in one step; fewer: the scene was cut
constexpr int kDescriptorMargin = 15;          // half the patch of a descriptor [px]
constexpr int kMinMatches = 100;               // fewer: optical flow
constexpr float kMaxRefinement = 4;  // a match that moves farther when it is refined goes [px]

/// The strongest corners of every cell, away from each other, so that a textured part of the image
/// cannot take all.
Places chooseCorners(const GreyImage& image, int max_corners) {
  std::vector<cv::Point2f> corners;  // strongest first
  cv::goodFeaturesToTrack(image.grey, corners, 0, kCornerQuality, 0, image.valid);
  const int width = image.grey.cols;
  const int height = image.grey.rows;
  SpacedPlaces spaced(width, height, static_cast<float>(kMinDistance * imageScale(width, height)));
  CellQuota quota(CellGrid(width, height, kSpreadCell), max_corners);
  Places chosen;
  for (const cv::Point2f& corner : corners) {
    if (static_cast<int>(chosen.size()) == max_corners) break;
    const Eigen::Vector2f place(corner.x, corner.y);
    if (spaced.take(place) && image.usable(corner) && quota.take(corner.x, corner.y)) {
      chosen.push_back(place);
    }
  }
  return chosen;
}

std::vector<cv::Point2f> asPoints(const Places& places) {
  std::vector<cv::Point2f> points;
  for (const Eigen::Vector2f& place : places) points.emplace_back(place.x(), place.y());
  return points;
}

/// @param to where the search begins; empty: at `from`. Gets where the points are.
/// @return   by point, whether it was found
std::vector<unsigned char> flow(
    const cv::Mat& before, const cv::Mat& now, const Places& from, int max_level, Places& to) {
  std::vector<unsigned char> found;
  if (from.empty()) return found;
  std::vector<cv::Point2f> points = asPoints(to);
  const int flags = to.empty() ? 0 : static_cast<int>(cv::OPTFLOW_USE_INITIAL_FLOW);
  const cv::TermCriteria stop(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, kMaxSteps, kMinStep);
  const cv::Size window(kWindow, kWindow);
  cv::calcOpticalFlowPyrLK(before,
                           now,
                           asPoints(from),
                           points,
                           found,
                           cv::noArray(),
                           window,
                           max_level,
                           stop,
                           flags,
                           kMinEigenvalue);
  to.clear();
  for (const cv::Point2f& point : points) to.emplace_back(point.x, point.y);
  return found;
}

}  // namespace

Features::Features(int max_corners, bool descriptors)
    : max_corners_(max_corners), descriptors_(descriptors) {}

void Features::start(FramePtr reference) {
  uses_flow_ = false;
  reference_mean_ = meanIntensity(*reference);
  frames_ = {std::move(reference)};
  places_.assign(1, {});
  if (descriptors_) {
    image_ = show(*frames_.front(), kDescriptorMargin);
    described_ = findFeatures(image_);
    for (const cv::KeyPoint& point : described_.points) {
      places_.front().emplace_back(point.pt.x, point.pt.y);
    }
  }
  if (size() < kMinMatches) changeToFlow();
}

int Features::track(FramePtr frame) {
  frames_.push_back(std::move(frame));
  uses_flow_ ? follow(*frames_.back()) : match(*frames_.back());
  if (!uses_flow_ && size() < kMinMatches) changeToFlow();
  return size();
}

GreyImage Features::show(const Frame& frame, int margin) const {
  return greyImage(frame.level(0), gainTowards(reference_mean_, frame), margin);
}

/// Follows corners through the frames given so far.
void Features::changeToFlow() {
  uses_flow_ = true;
  survivor_share_ = 1;
  image_ = show(*frames_.front(), kWindow / 2);
  places_ = {chooseCorners(image_, max_corners_)};
  for (std::size_t k = 1; k < frames_.size(); ++k) follow(*frames_[k]);
}

void Features::follow(const Frame& frame) {
  const GreyImage before = std::exchange(image_, show(frame, kWindow / 2));
  const Places from = places_.back();
  Places to;
  Places back;
  const auto forward = flow(before.grey, image_.grey, from, kMaxLevel, to);
  const auto backward = flow(image_.grey, before.grey, to, kMaxLevel, back);
  places_.push_back(to);
  std::size_t kept = 0;
  for (std::size_t i = 0; i < from.size(); ++i) {
    const bool returns =
        forward[i] != 0 && backward[i] != 0 && (back[i] - from[i]).norm() < kMaxBackwardError;
    if (!returns || !isUsable(to[i], image_.grey.size(), image_.valid)) continue;
    for (Places& places : places_) places[kept] = places[i];
    ++kept;
  }
  for (Places& places : places_) places.resize(kept);
  survivor_share_ = from.empty() ? 1 : static_cast<double>(kept) / static_cast<double>(from.size());
}

/// Matches are refined by one level of Lucas-Kanade.
void Features::match(const Frame& frame) {
  const GreyImage image = show(frame, kDescriptorMargin);
  const dsorb::Features found = findFeatures(image);
  const std::vector<int> partner = matchFeatures(described_, found);
  std::vector<std::size_t> which;
  Places from;
  Places matched;
  for (std::size_t i = 0; i < partner.size(); ++i) {
    if (partner[i] < 0) continue;
    const cv::Point2f& at = found.points[static_cast<std::size_t>(partner[i])].pt;
    which.push_back(i);
    from.push_back(places_.front()[i]);
    matched.emplace_back(at.x, at.y);
  }
  Places refined = matched;
  const auto aligned = flow(image_.grey, image.grey, from, 0, refined);
  places_.emplace_back(partner.size(), Eigen::Vector2f::Constant(NAN));
  for (std::size_t k = 0; k < which.size(); ++k) {
    const bool near = aligned[k] != 0 && (refined[k] - matched[k]).norm() <= kMaxRefinement;
    if (near && isUsable(refined[k], image.grey.size(), image.valid))
      places_.back()[which[k]] = refined[k];
  }
}

void Features::keepWithin(int budget_mb) {
  while (frames_.size() > waitingFrames(*frames_.front(), budget_mb)) {
    const auto dropped = static_cast<std::ptrdiff_t>(
        leastMissed(frames_, [](const FramePtr& frame) -> const Frame& { return *frame; }));
    frames_.erase(frames_.begin() + dropped);
    places_.erase(places_.begin() + dropped);
  }
}

int Features::size() const {
  return static_cast<int>(std::count_if(places_.back().begin(), places_.back().end(), isSeen));
}

bool Features::cut() const {
  return uses_flow_ && survivor_share_ < kMinSurvivorShare;
}

CornerTracks Features::tracks() const {
  CornerTracks tracks;
  for (const Places& places : places_) {
    tracks.positions.emplace_back();
    for (std::size_t i = 0; i < places.size(); ++i) {
      if (isSeen(places_.back()[i])) tracks.positions.back().push_back(places[i]);
    }
  }
  return tracks;
}

}  // namespace dsorb::published
