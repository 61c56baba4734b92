// SPDX-License-Identifier: BSD-3-Clause
#include "features/feature_matches.h"

#include "base/parallel.h"
#include "base/target_clones.h"
#include "image/cell_grid.h"

#include <opencv2/features2d.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>

namespace dsorb {
namespace {

constexpr int kLevels = 8;            // of the image pyramid
constexpr float kScaleFactor = 1.2F;  // between two levels
constexpr int kFastThreshold = 7;     // contrast of a FAST corner to its ring [grey levels]
constexpr int kPatchSize = 31;  // [px] of the level; side of the square a descriptor is made from
constexpr int kSurplus = 10;    // features found for each that is kept when they are spread
constexpr std::size_t kDistanceGrain = 32;  // rows of distances one thread takes at a time
constexpr float kSamePlace = 5;             // features closer together are no rivals [px]

/// Keeps the strongest features of every grid cell.
void spread(const GreyImage& image, int count, std::vector<cv::KeyPoint>& points) {
  std::sort(points.begin(), points.end(), stronger);
  CellQuota quota(CellGrid(image.grey.cols, image.grey.rows, kSpreadCell), count);
  std::size_t kept = 0;
  for (const cv::KeyPoint& point : points) {
    if (!image.usable(point.pt) || !quota.take(point.pt.x, point.pt.y)) continue;
    points[kept++] = point;
    if (static_cast<int>(kept) == count) break;
  }
  points.resize(kept);
  points.shrink_to_fit();  // of ten times as many
}

cv::Ptr<cv::ORB> makeDetector(int count) {
  return cv::ORB::create(kSurplus * count,
                         kScaleFactor,
                         kLevels,
                         kPatchSize,
                         0,
                         2,
                         cv::ORB::HARRIS_SCORE,
                         kPatchSize,
                         kFastThreshold);
}

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

Features findFeatures(const GreyImage& image, int count) {
  Features features;
  const cv::Ptr<cv::ORB> detector = makeDetector(count);
  detector->detect(image.grey, features.points, image.valid);
  spread(image, count, features.points);
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

}  // namespace dsorb
