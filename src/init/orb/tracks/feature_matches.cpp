// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/tracks/feature_matches.h"

#include "base/target_clones.h"
#include "image/cell_grid.h"
#include "init/orb/tracks/lucas_kanade.h"
#include "init/orb/tracks/opencv_flow.h"

#include <opencv2/features2d.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>

namespace dsorb::init_orb {
namespace {

constexpr int kLevels = 8;            // of the image pyramid
constexpr float kScaleFactor = 1.2F;  // between two levels
constexpr int kFastThreshold = 7;     // contrast of a FAST corner to its ring [grey levels]
constexpr int kPatchSize = 31;  // [px] of the level; side of the square a descriptor is made from
constexpr int kSurplus = 10;    // features found for each that is kept when they are spread

/// Keeps the strongest features of every grid cell.
void spread(const GreyImage& image, int max_features, std::vector<cv::KeyPoint>& points) {
  std::sort(points.begin(), points.end(), stronger);
  CellQuota quota(CellGrid(image.grey.cols, image.grey.rows, kSpreadCell), max_features);
  std::size_t kept = 0;
  for (const cv::KeyPoint& point : points) {
    if (!image.usable(point.pt) || !quota.take(point.pt.x, point.pt.y)) continue;
    points[kept++] = point;
    if (static_cast<int>(kept) == max_features) break;
  }
  points.resize(kept);
  points.shrink_to_fit();  // of ten times as many
}

cv::Ptr<cv::ORB> makeDetector(int max_features) {
  return cv::ORB::create(kSurplus * max_features,
                         kScaleFactor,
                         kLevels,
                         kPatchSize,
                         0,
                         2,
                         cv::ORB::HARRIS_SCORE,
                         kPatchSize,
                         kFastThreshold);
}

cv::Point2f toCv(const Eigen::Vector2f& point) {
  return {point.x(), point.y()};
}

Eigen::Vector2f toEigen(const cv::Point2f& point) {
  return {point.x, point.y};
}

const Eigen::Vector2f kNotSeen = Eigen::Vector2f::Constant(NAN);

/// 256 bits of an ORB descriptor.
using Descriptor = std::array<std::uint64_t, 4>;

std::vector<Descriptor> descriptorsOf(const Features& features) {
  std::vector<Descriptor> descriptors(features.points.size());
  for (std::size_t i = 0; i < descriptors.size(); ++i) {
    std::memcpy(&descriptors[i], features.descriptors.ptr(static_cast<int>(i)), sizeof(Descriptor));
  }
  return descriptors;
}

/// The nearest descriptors of another image.
struct Nearest {
  int index = -1;
  int distance = 257;  // [bits]
  int second = 257;    // distance of the second nearest
};

/// Compares all with all; the first of several at the same distance counts as the nearest.
DSORB_TARGET_CLONES void findNearest(const std::vector<Descriptor>& from,
                                     const std::vector<Descriptor>& to,
                                     std::vector<Nearest>& forward,
                                     std::vector<Nearest>& backward) {
  const int from_count = static_cast<int>(from.size());
  const int to_count = static_cast<int>(to.size());
  for (int i = 0; i < from_count; ++i) {
    const Descriptor a = from[static_cast<std::size_t>(i)];
    Nearest best;
    for (int j = 0; j < to_count; ++j) {
      const Descriptor& b = to[static_cast<std::size_t>(j)];
      const int distance = __builtin_popcountll(a[0] ^ b[0]) + __builtin_popcountll(a[1] ^ b[1]) +
                           __builtin_popcountll(a[2] ^ b[2]) + __builtin_popcountll(a[3] ^ b[3]);
      if (distance < best.distance) {
        best = {j, distance, best.distance};
      } else if (distance < best.second) {
        best.second = distance;
      }
      Nearest& back = backward[static_cast<std::size_t>(j)];
      if (distance < back.distance) back = {i, distance, back.distance};
    }
    forward[static_cast<std::size_t>(i)] = best;
  }
}

}  // namespace

Features findFeatures(const GreyImage& image, int max_features) {
  Features features;
  const cv::Ptr<cv::ORB> detector = makeDetector(max_features);
  detector->detect(image.grey, features.points, image.valid);
  spread(image, max_features, features.points);
  detector->compute(image.grey, features.points, features.descriptors);
  return features;
}

std::vector<int> matchFeatures(const Features& from, const Features& to) {
  std::vector<int> partner(from.points.size(), -1);
  std::vector<Nearest> forward(from.points.size());
  std::vector<Nearest> backward(to.points.size());
  findNearest(descriptorsOf(from), descriptorsOf(to), forward, backward);
  for (std::size_t i = 0; i < forward.size(); ++i) {
    const Nearest& best = forward[i];
    if (best.index < 0 || best.distance > kMaxDistance) continue;
    const bool mutual = backward[static_cast<std::size_t>(best.index)].index == static_cast<int>(i);
    const bool clear = best.distance < kMaxRatio * best.second;
    if (mutual && clear) partner[i] = best.index;
  }
  return partner;
}

const std::vector<Eigen::Vector2f>& FeatureMatches::start(const Frame& reference) {
  image_ = greyImage(reference.level(0), 1.0F, kPatchSize / 2);
  mean_ = meanIntensity(reference);
  features_ = findFeatures(image_, max_features_);
  positions_.clear();
  for (const cv::KeyPoint& point : features_.points) positions_.push_back(toEigen(point.pt));
  return positions_;
}

std::vector<Eigen::Vector2f> FeatureMatches::find(const Frame& frame) const {
  const GreyImage image = greyImage(frame.level(0), gainTowards(mean_, frame), kPatchSize / 2);
  const Features found = findFeatures(image, max_features_);
  const std::vector<int> partner = matchFeatures(features_, found);
  std::vector<Eigen::Vector2f> observations(positions_.size(), kNotSeen);
  for (std::size_t i = 0; i < partner.size(); ++i) {
    if (partner[i] < 0) continue;
    observations[i] = toEigen(found.points[static_cast<std::size_t>(partner[i])].pt);
  }
  refine(image, observations);
  return observations;
}

void FeatureMatches::refine(const GreyImage& image,
                            std::vector<Eigen::Vector2f>& observations) const {
  std::vector<std::size_t> which;
  std::vector<cv::Point2f> start;
  std::vector<cv::Point2f> end;
  for (std::size_t i = 0; i < observations.size(); ++i) {
    if (!isSeen(observations[i])) continue;
    which.push_back(i);
    start.push_back(toCv(positions_[i]));
    end.push_back(toCv(observations[i]));
  }
  if (which.empty()) return;
  const std::vector<cv::Point2f> matched = end;
  LucasKanadeOptions flow;
  flow.max_level = 0;
  flow.min_eigenvalue = kMinTexture;
  const std::vector<unsigned char> found =
      followWithOpenCv(image_.grey, image.grey, start, flow, end);
  for (std::size_t k = 0; k < which.size(); ++k) {
    const cv::Point2f moved = end[k] - matched[k];
    const bool kept =
        found[k] != 0 && std::hypot(moved.x, moved.y) <= kMaxRefinement && image.usable(end[k]);
    observations[which[k]] = kept ? toEigen(end[k]) : kNotSeen;
  }
}

}  // namespace dsorb::init_orb
