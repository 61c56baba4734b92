// SPDX-License-Identifier: BSD-3-Clause
#include "features/feature_matches.h"

#include "base/parallel.h"
#include "base/target_clones.h"
#include "features/grey_image.h"
#include "features/lucas_kanade.h"
#include "image/cell_grid.h"
#include "image/image_scale.h"

#include <Eigen/Core>
#include <opencv2/features2d.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <utility>

namespace dsorb {
namespace {

constexpr int kLevels = 8;            // of the image pyramid
constexpr float kScaleFactor = 1.2F;  // between two levels
constexpr int kFastThreshold = 7;     // contrast of a FAST corner to its ring [grey levels]
constexpr int kPatchSize = 31;   // [px] of the level; side of the square a descriptor is made from
constexpr int kSurplus = 10;     // features found for each that is kept when they are spread
constexpr float kSamePlace = 5;  // features closer together are no rivals [px]

/// Strongest first; position decides between equals, so that the order is the same everywhere.
bool stronger(const cv::KeyPoint& a, const cv::KeyPoint& b) {
  if (a.response != b.response) return a.response > b.response;
  if (a.pt.y != b.pt.y) return a.pt.y < b.pt.y;
  return a.pt.x < b.pt.x;
}

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

constexpr int kInvalidMargin = 15;      // of invalid pixels: half of what ORB describes [px]
constexpr double kWindow = 40;          // around a prediction, for a diagonal of 800 px [px]
constexpr std::size_t kNeighbours = 5;  // whose motion predicts that of a feature

/// Motion of a feature as those matches tell that are nearest to it: medians of the coordinates.
/// @param matched features of `from` with a partner, at least kNeighbours; the order is changed
Eigen::Vector2f motionNear(const DescribedFrame& from,
                           const DescribedFrame& to,
                           const std::vector<int>& partner,
                           const Eigen::Vector2f& place,
                           std::vector<std::size_t>& matched) {
  const auto end = matched.begin() + static_cast<std::ptrdiff_t>(kNeighbours);
  std::partial_sort(matched.begin(), end, matched.end(), [&](std::size_t a, std::size_t b) {
    const float to_a = (from.positions[a] - place).squaredNorm();
    const float to_b = (from.positions[b] - place).squaredNorm();
    return to_a != to_b ? to_a < to_b : a < b;
  });
  std::array<float, kNeighbours> x{};
  std::array<float, kNeighbours> y{};
  for (std::size_t k = 0; k < kNeighbours; ++k) {
    const std::size_t i = matched[k];
    const Eigen::Vector2f moved =
        to.positions[static_cast<std::size_t>(partner[i])] - from.positions[i];
    x[k] = moved.x();
    y[k] = moved.y();
  }
  std::sort(x.begin(), x.end());
  std::sort(y.begin(), y.end());
  return {x[kNeighbours / 2], y[kNeighbours / 2]};
}

/// Leaves the distances to what lies near the place that the matches close by predict.
void keepPredicted(const DescribedFrame& from,
                   const DescribedFrame& to,
                   const std::vector<int>& partner,
                   Distances& distances) {
  std::vector<std::size_t> matched;
  for (std::size_t i = 0; i < partner.size(); ++i) {
    if (partner[i] >= 0) matched.push_back(i);
  }
  if (matched.size() < kNeighbours) return;
  const Frame& image = *to.frame;
  const auto window = static_cast<float>(kWindow * imageScale(image.width(), image.height()));
  forEachRange(partner.size(), kTaskGrain, [&](std::size_t begin, std::size_t end) {
    std::vector<std::size_t> nearest = matched;
    for (std::size_t i = begin; i < end; ++i) {
      const Eigen::Vector2f& place = from.positions[i];
      const Eigen::Vector2f expected = place + motionNear(from, to, partner, place, nearest);
      float* row = distances.row(i);
      for (std::size_t j = 0; j < to.positions.size(); ++j) {
        if (!((to.positions[j] - expected).squaredNorm() < window * window))
          row[j] = Distances::kNone;
      }
    }
  });
}

constexpr LucasKanadeOptions kRefinement{0, kMinTexture};

/// The images of two frames, for Lucas-Kanade. Kept only while they are compared: many frames wait.
struct ImagePair {
  FlowPyramid from;
  FlowPyramid to;
  cv::Mat valid;  // mask of `to`

  ImagePair(const DescribedFrame& from_frame, const DescribedFrame& to_frame)
      : valid(to_frame.valid) {
    from.build(from_frame.frame->level(0), from_frame.gain, kRefinement);
    to.build(to_frame.frame->level(0), to_frame.gain, kRefinement);
  }
};

/// Moves a match to where both patches agree. @return whether it is one
bool refine(const ImagePair& images,
            const Eigen::Vector2f& start,
            LucasKanade& flow,
            Eigen::Vector2f& place) {
  const Eigen::Vector2f matched = place;
  const cv::Size size(images.to.levels().front().width, images.to.levels().front().height);
  if (!flow.follow(images.from, images.to, start, place)) return false;
  if (!((place - matched).norm() <= kMaxRefinement) || !isUsable(place, size, images.valid)) {
    return false;
  }
  Eigen::Vector2f back = start;
  return flow.follow(images.to, images.from, place, back) &&
         (back - start).norm() < kMaxBackwardError;
}

/// Between ORB descriptors [bits]. Runs in parallel inside the caller's arena.
Distances hammingDistances(const Features& from, const Features& to) {
  Distances distances(from.points.size(), to.points.size());
  std::vector<Bits> bits(to.points.size());
  for (std::size_t j = 0; j < bits.size(); ++j) {
    std::memcpy(&bits[j], to.descriptors.ptr(static_cast<int>(j)), sizeof(Bits));
  }
  forEachRange(from.points.size(), kTaskGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      Bits a;
      std::memcpy(&a, from.descriptors.ptr(static_cast<int>(i)), sizeof(Bits));
      hammingRow(a, bits.data(), bits.size(), distances.row(i));
    }
  });
  return distances;
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

std::vector<Eigen::Vector2f> positionsOf(const Features& features) {
  std::vector<Eigen::Vector2f> positions;
  for (const cv::KeyPoint& point : features.points) positions.emplace_back(point.pt.x, point.pt.y);
  return positions;
}

DescribedFrame describeFrame(FramePtr frame, float gain) {
  DescribedFrame described;
  const GreyImage image = greyImage(frame->level(0), gain, kInvalidMargin);
  described.features = findFeatures(image);
  described.positions = positionsOf(described.features);
  described.valid = image.valid;
  described.frame = std::move(frame);
  described.gain = gain;
  return described;
}

std::vector<int> findPartners(const DescribedFrame& from, const DescribedFrame& to) {
  Distances distances = hammingDistances(from.features, to.features);
  const auto partners = [&] {
    return partnersOf(distances, to.positions, kMaxRatio, kMaxDistance);
  };
  keepPredicted(from, to, partners(), distances);
  return partners();
}

std::vector<Eigen::Vector2f> findAgain(const DescribedFrame& from, const DescribedFrame& to) {
  std::vector<Eigen::Vector2f> places(from.positions.size(), Eigen::Vector2f::Constant(NAN));
  if (places.empty() || to.positions.empty()) return places;
  const std::vector<int> partner = findPartners(from, to);
  const ImagePair images(from, to);
  forEachRange(places.size(), kTaskGrain, [&](std::size_t begin, std::size_t end) {
    LucasKanade flow(kRefinement);
    for (std::size_t i = begin; i < end; ++i) {
      if (partner[i] < 0) continue;
      Eigen::Vector2f place = to.positions[static_cast<std::size_t>(partner[i])];
      if (refine(images, from.positions[i], flow, place)) places[i] = place;
    }
  });
  return places;
}

}  // namespace dsorb
