// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/semi_dense/corner_prior.h"

#include "image/image_scale.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

namespace dsorb::init_orb {
namespace {

// Corners farther away do not count, for an image diagonal of 800 px [px].
constexpr double kRadius = 60;
constexpr float kCellSize = 0.5F;          // of the radius
constexpr std::size_t kNeighbours = 5;     // nearest corners a prior is made of
constexpr std::size_t kMinNeighbours = 3;  // for a spread that means something
constexpr float kWiden = 2;                // of the range of all corners

std::vector<Eigen::Vector2f> pixelsOf(const std::vector<Corner>& corners) {
  std::vector<Eigen::Vector2f> pixels;
  pixels.reserve(corners.size());
  for (const Corner& corner : corners) pixels.push_back(corner.seen());
  return pixels;
}

}  // namespace

CornerPrior::CornerPrior(const std::vector<Corner>& corners, int width, int height)
    : radius_(static_cast<float>(kRadius * imageScale(width, height))),
      grid_(pixelsOf(corners), CellGrid(width, height, kCellSize * radius_)) {
  float low = std::numeric_limits<float>::max();
  float high = std::numeric_limits<float>::lowest();
  depths_.reserve(corners.size());
  for (const Corner& corner : corners) {
    depths_.push_back({corner.seen(),
                       static_cast<float>(corner.inverse_depth),
                       static_cast<float>(corner.variance)});
    low = std::min(low, depths_.back().inverse_depth);
    high = std::max(high, depths_.back().inverse_depth);
  }
  low /= kWiden;
  high *= kWiden;
  const float sigma = 0.5F * (high - low) / kSearchSigmas;
  wide_ = {{0, 0}, 0.5F * (low + high), sigma * sigma};
}

SemiDensePoint CornerPrior::at(const Eigen::Vector2f& pixel) const {
  const auto neighbours = grid_.nearest<kNeighbours>(pixel, radius_);
  if (neighbours.count < kMinNeighbours) return {pixel, wide_.inverse_depth, wide_.variance};
  float sum = 0;
  float mean = 0;
  for (const auto& [squared_distance, corner] : neighbours) {
    const float weight = 1.0F / (1.0F + std::sqrt(squared_distance));
    sum += weight;
    mean += weight * depths_[corner].inverse_depth;
  }
  mean /= sum;
  float variance = 0;
  for (const auto& [squared_distance, corner] : neighbours) {
    const float weight = 1.0F / (1.0F + std::sqrt(squared_distance));
    const float difference = depths_[corner].inverse_depth - mean;
    variance += weight * (difference * difference + depths_[corner].variance);
  }
  const float floor = kMinPriorSigma * mean;
  return {pixel, mean, std::max(variance / sum, floor * floor)};
}

}  // namespace dsorb::init_orb
