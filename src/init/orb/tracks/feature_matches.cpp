// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/tracks/feature_matches.h"

#include "base/parallel.h"
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
constexpr std::size_t kDistanceGrain = 32;  // rows of distances one thread takes at a time
constexpr float kSamePlace = 5;             // features closer together are no rivals [px]

/// Keeps the strongest features of every grid cell.
void spread(const GreyImage& image, std::vector<cv::KeyPoint>& points) {
  std::sort(points.begin(), points.end(), stronger);
  CellQuota quota(CellGrid(image.grey.cols, image.grey.rows, kSpreadCell), kMaxFeatures);
  std::size_t kept = 0;
  for (const cv::KeyPoint& point : points) {
    if (!image.usable(point.pt) || !quota.take(point.pt.x, point.pt.y)) continue;
    points[kept++] = point;
    if (static_cast<int>(kept) == kMaxFeatures) break;
  }
  points.resize(kept);
  points.shrink_to_fit();  // of ten times as many
}

cv::Ptr<cv::ORB> makeDetector() {
  return cv::ORB::create(kSurplus * kMaxFeatures,
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
using Bits = std::array<std::uint64_t, 4>;

DSORB_TARGET_CLONES void hammingRow(const Bits& a, const Bits* to, std::size_t count, float* row) {
  for (std::size_t j = 0; j < count; ++j) {
    const Bits& b = to[j];
    row[j] =
        static_cast<float>(__builtin_popcountll(a[0] ^ b[0]) + __builtin_popcountll(a[1] ^ b[1]) +
                           __builtin_popcountll(a[2] ^ b[2]) + __builtin_popcountll(a[3] ^ b[3]));
  }
}

}  // namespace

Features findFeatures(const GreyImage& image) {
  Features features;
  const cv::Ptr<cv::ORB> detector = makeDetector();
  detector->detect(image.grey, features.points, image.valid);
  spread(image, features.points);
  detector->compute(image.grey, features.points, features.descriptors);
  return features;
}

Distances hammingDistances(const Features& from, const Features& to) {
  Distances distances(from.points.size(), to.points.size());
  std::vector<Bits> bits(to.points.size());
  for (std::size_t j = 0; j < bits.size(); ++j) {
    std::memcpy(&bits[j], to.descriptors.ptr(static_cast<int>(j)), sizeof(Bits));
  }
  forEachRange(from.points.size(), kDistanceGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      Bits a;
      std::memcpy(&a, from.descriptors.ptr(static_cast<int>(i)), sizeof(Bits));
      hammingRow(a, bits.data(), bits.size(), distances.row(i));
    }
  });
  return distances;
}

std::vector<int> partnersOf(const Distances& distances,
                            const std::vector<Eigen::Vector2f>& places,
                            double max_ratio,
                            double max_distance) {
  std::vector<int> partner(distances.rows(), -1);
  if (distances.columns() == 0) return partner;
  std::vector<int> back(distances.columns(), -1);
  std::vector<float> nearest(distances.columns(), Distances::kNone);
  for (std::size_t i = 0; i < distances.rows(); ++i) {
    const float* row = distances.row(i);
    std::size_t best = 0;
    for (std::size_t j = 0; j < distances.columns(); ++j) {
      if (row[j] < row[best]) best = j;
      if (row[j] < nearest[j]) {
        nearest[j] = row[j];
        back[j] = static_cast<int>(i);
      }
    }
    if (!(row[best] <= max_distance)) continue;
    float second = Distances::kNone;
    for (std::size_t j = 0; j < distances.columns(); ++j) {
      if (j == best || !(row[j] < second)) continue;
      if (places.empty() || (places[j] - places[best]).norm() > kSamePlace) second = row[j];
    }
    if (row[best] < max_ratio * second) partner[i] = static_cast<int>(best);
  }
  for (std::size_t i = 0; i < partner.size(); ++i) {
    if (partner[i] >= 0 && back[static_cast<std::size_t>(partner[i])] != static_cast<int>(i))
      partner[i] = -1;
  }
  return partner;
}

std::vector<int> matchFeatures(const Features& from, const Features& to) {
  return partnersOf(hammingDistances(from, to), {}, kMaxRatio, kMaxDistance);
}

const std::vector<Eigen::Vector2f>& FeatureMatches::start(const Frame& reference) {
  image_ = greyImage(reference.level(0), 1.0F, kPatchSize / 2);
  mean_ = meanIntensity(reference);
  features_ = findFeatures(image_);
  positions_.clear();
  for (const cv::KeyPoint& point : features_.points) positions_.push_back(toEigen(point.pt));
  return positions_;
}

std::vector<Eigen::Vector2f> FeatureMatches::find(const Frame& frame) const {
  const GreyImage image = greyImage(frame.level(0), gainTowards(mean_, frame), kPatchSize / 2);
  const Features found = findFeatures(image);
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
