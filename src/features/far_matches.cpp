// SPDX-License-Identifier: BSD-3-Clause
#include "features/far_matches.h"

#include "base/parallel.h"
#include "features/feature_matches.h"
#include "features/grey_image.h"
#include "features/lucas_kanade.h"
#include "image/image_scale.h"

#include <Eigen/Core>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <utility>

namespace dsorb {
namespace {

constexpr int kInvalidMargin = 15;         // of invalid pixels: half of what ORB describes [px]
constexpr std::size_t kFeatureGrain = 32;  // features one thread refines at a time
constexpr double kWindow = 40;             // around a prediction, for a diagonal of 800 px [px]
constexpr std::size_t kNeighbours = 5;     // whose motion predicts that of a feature

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
  forEachRange(partner.size(), kFeatureGrain, [&](std::size_t begin, std::size_t end) {
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

LucasKanadeOptions refinement() {
  LucasKanadeOptions options;
  options.max_level = 0;
  options.min_eigenvalue = kMinTexture;
  return options;
}

/// The images of two frames, for Lucas-Kanade. Kept only while they are compared: many frames wait.
struct ImagePair {
  FlowPyramid from;
  FlowPyramid to;
  cv::Mat valid;  // mask of `to`

  ImagePair(const DescribedFrame& from_frame, const DescribedFrame& to_frame)
      : valid(to_frame.valid) {
    from.build(from_frame.frame->level(0), from_frame.gain, refinement());
    to.build(to_frame.frame->level(0), to_frame.gain, refinement());
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

}  // namespace

DescribedFrame describeFrame(FramePtr frame, float gain) {
  DescribedFrame described;
  const GreyImage image = greyImage(frame->level(0), gain, kInvalidMargin);
  described.features = findFeatures(image);
  for (const cv::KeyPoint& point : described.features.points) {
    described.positions.emplace_back(point.pt.x, point.pt.y);
  }
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
  forEachRange(places.size(), kFeatureGrain, [&](std::size_t begin, std::size_t end) {
    LucasKanade flow(refinement());
    for (std::size_t i = begin; i < end; ++i) {
      if (partner[i] < 0) continue;
      Eigen::Vector2f place = to.positions[static_cast<std::size_t>(partner[i])];
      if (refine(images, from.positions[i], flow, place)) places[i] = place;
    }
  });
  return places;
}

}  // namespace dsorb
