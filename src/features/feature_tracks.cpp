// SPDX-License-Identifier: BSD-3-Clause
#include "features/feature_tracks.h"

#include "base/parallel.h"
#include "features/grey_image.h"
#include "image/cell_grid.h"
#include "image/image_scale.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <tuple>
#include <utility>

namespace dsorb {
namespace {

constexpr int kBandRows = 64;  // that one task takes at a time
constexpr int kBlock = 3;      // side of the square whose gradients are summed [px]
constexpr int kMargin = 2;     // rows around a band: one for the square, one for the neighbours

struct Band {
  float strongest = 0;  // of all pixels, maxima or not
  std::vector<DetectedCorner> maxima;
};

/// Rows [first, last) of an image.
Band findMaxima(const cv::Mat& grey, const cv::Mat& valid, int first, int last) {
  const int top = std::max(first - kMargin, 0);
  const int bottom = std::min(last + kMargin, grey.rows);
  cv::Mat strength;
  cv::Mat highest;
  cv::cornerMinEigenVal(grey.rowRange(top, bottom), strength, kBlock);
  cv::dilate(strength, highest, cv::Mat());
  Band band;
  for (int y = first; y < last; ++y) {
    const auto* here = strength.ptr<float>(y - top);
    const auto* around = highest.ptr<float>(y - top);
    const auto* usable = valid.empty() ? nullptr : valid.ptr<std::uint8_t>(y);
    const bool outermost_row = y == 0 || y == grey.rows - 1;
    for (int x = 0; x < grey.cols; ++x) {
      if (usable != nullptr && usable[x] == 0) continue;
      band.strongest = std::max(band.strongest, here[x]);
      const bool outermost = outermost_row || x == 0 || x == grey.cols - 1;
      if (here[x] > 0 && here[x] == around[x] && !outermost) {
        band.maxima.push_back({here[x], x, y});
      }
    }
  }
  return band;
}

/// The order of corners: among equally strong ones the lowest and rightmost comes first, as with
/// OpenCV.
bool isStronger(const DetectedCorner& a, const DetectedCorner& b) {
  return std::tie(a.strength, a.y, a.x) > std::tie(b.strength, b.y, b.x);
}

constexpr double kMinDistance = 8;  // between corners, for an image diagonal of 800 px [px]

bool isInside(const Eigen::Vector2f& corner, const cv::Size& size) {
  return corner.x() >= kFeatureBorder && corner.y() >= kFeatureBorder &&
         corner.x() <= static_cast<float>(size.width - 1 - kFeatureBorder) &&
         corner.y() <= static_cast<float>(size.height - 1 - kFeatureBorder);
}

LucasKanadeOptions flowOptions(const FeatureTrackOptions& options) {
  LucasKanadeOptions flow;
  flow.max_level = options.max_level;
  flow.min_eigenvalue = options.min_eigenvalue;
  return flow;
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

std::vector<DetectedCorner> detectCorners(const cv::Mat& grey,
                                          const cv::Mat& valid,
                                          double quality) {
  std::vector<Band> bands(static_cast<std::size_t>((grey.rows + kBandRows - 1) / kBandRows));
  forEachRange(bands.size(), 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const int first = static_cast<int>(i) * kBandRows;
      bands[i] = findMaxima(grey, valid, first, std::min(first + kBandRows, grey.rows));
    }
  });
  float strongest = 0;
  for (const Band& band : bands) strongest = std::max(strongest, band.strongest);
  const auto least = static_cast<float>(quality * strongest);
  std::vector<DetectedCorner> corners;
  for (const Band& band : bands) {
    std::copy_if(band.maxima.begin(),
                 band.maxima.end(),
                 std::back_inserter(corners),
                 [&](const DetectedCorner& corner) { return corner.strength > least; });
  }
  std::sort(corners.begin(), corners.end(), isStronger);
  return corners;
}

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
  std::vector<Eigen::Vector2f> chosen;
  for (const DetectedCorner& corner : detectCorners(grey, valid, options.corner_quality)) {
    if (chosen.size() == wanted) break;
    const Eigen::Vector2f place(static_cast<float>(corner.x), static_cast<float>(corner.y));
    if (spaced.take(place) && isInside(place, size) && quota.take(place.x(), place.y())) {
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
  valid_ = all_valid ? cv::Mat() : validMask(frame.level(0), LucasKanadeOptions().window / 2);
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
  std::vector<Eigen::Vector2f> after = before;
  std::vector<Eigen::Vector2f> back = before;
  std::vector<char> alive = follow(after, back);
  for (std::size_t i = 0; i < alive.size(); ++i) {
    if (!((back[i] - before[i]).norm() < kMaxBackwardError)) alive[i] = 0;
  }
  positions_.push_back(std::move(after));
  keepOnly(alive);
}

std::vector<char> FeatureTracks::follow(std::vector<Eigen::Vector2f>& places,
                                        std::vector<Eigen::Vector2f>& back) const {
  const cv::Size size(pyramid_.levels().front().width, pyramid_.levels().front().height);
  std::vector<char> found(places.size());
  forEachRange(places.size(), kTaskGrain, [&](std::size_t begin, std::size_t end) {
    LucasKanade lucas_kanade(flowOptions(options_));
    for (std::size_t i = begin; i < end; ++i) {
      if (!lucas_kanade.follow(other_pyramid_, pyramid_, places[i])) continue;
      back[i] = places[i];
      found[i] = isUsable(places[i], size, valid_) &&
                         lucas_kanade.follow(pyramid_, other_pyramid_, back[i])
                     ? 1
                     : 0;
    }
  });
  return found;
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

CornerTracks FeatureTracks::since(int reference) const {
  CornerTracks tracks;
  for (auto frame = positions_.begin() + reference; frame != positions_.end(); ++frame) {
    tracks.positions.emplace_back(frame->begin(), frame->begin() + sizeSince(reference));
  }
  return tracks;
}

}  // namespace dsorb
