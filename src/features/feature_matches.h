// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "features/features.h"
#include "features/grey_image.h"

#include <Eigen/Core>
#include <opencv2/core.hpp>

#include <cstddef>
#include <limits>
#include <vector>

namespace dsorb {

/// ORB features of an image, spread over it. @param count at most so many
/// @source Rublee, Rabaud, Konolige, Bradski, ORB: an efficient alternative to SIFT or SURF,
///         ICCV 2011
Features findFeatures(const GreyImage& image, int count = kMaxFeatures);

constexpr double kMaxRatio = 0.8;  ///< of the best distance to the second best
constexpr int kMaxDistance = 64;   ///< between two descriptors [bits of 256]

/// Distances between the descriptors of two images, [from][to].
class Distances {
 public:
  static constexpr float kNone = std::numeric_limits<float>::infinity();

  Distances(std::size_t rows, std::size_t columns)
      : rows_(rows), columns_(columns), values_(rows * columns, kNone) {}

  [[nodiscard]] std::size_t rows() const { return rows_; }
  [[nodiscard]] std::size_t columns() const { return columns_; }
  [[nodiscard]] float* row(std::size_t i) { return values_.data() + i * columns_; }
  [[nodiscard]] const float* row(std::size_t i) const { return values_.data() + i * columns_; }

 private:
  std::size_t rows_;
  std::size_t columns_;
  std::vector<float> values_;
};

/// Between ORB descriptors [bits]. Runs in parallel inside the caller's arena.
Distances hammingDistances(const Features& from, const Features& to);

/// Partner of each row, -1 without one: nearest to each other, near enough, and clearly nearer than
/// any rival.
/// @param places of the columns [px]: those near the partner are no rivals; empty: all others are
std::vector<int> partnersOf(const Distances& distances,
                            const std::vector<Eigen::Vector2f>& places,
                            double max_ratio,
                            double max_distance);

/// Index of the partner of each ORB feature of `from`, -1 without one.
std::vector<int> matchFeatures(const Features& from, const Features& to);

}  // namespace dsorb
