// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/frame.h"

#include "features/grey_image.h"

#include <Eigen/Core>
#include <opencv2/core.hpp>

#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

namespace dsorb {

constexpr float kMaxRefinement = 4;  ///< a match that moves farther when it is refined goes [px]
/// Least smaller eigenvalue of the gradient tensor of a match [grey levels^2 / px^2].
constexpr double kMinTexture = 0.1;

/// Features of one image, the strongest first.
struct Features {
  std::vector<cv::KeyPoint> points;
  cv::Mat descriptors;  ///< a row each: 32 bytes of ORB, 128 floats of SIFT
};

/// Where the features are [px].
[[nodiscard]] std::vector<Eigen::Vector2f> positionsOf(const Features& features);

/// Whether a feature was found; positions of those that were not are NaN.
inline bool isSeen(const Eigen::Vector2f& position) {
  return std::isfinite(position.x());
}

/// ORB features of an image, spread over it. @param count at most so many
/// @source Rublee, Rabaud, Konolige, Bradski, ORB: an efficient alternative to SIFT or SURF,
///         ICCV 2011
Features findFeatures(const GreyImage& image, int count = 2000);

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

/// Partner of each row, -1 without one: nearest to each other, near enough, and clearly nearer than
/// any rival.
/// @param places of the columns [px]: those near the partner are no rivals; empty: all others are
std::vector<int> partnersOf(const Distances& distances,
                            const std::vector<Eigen::Vector2f>& places,
                            double max_ratio,
                            double max_distance);

/// Index of the partner of each ORB feature of `from`, -1 without one.
std::vector<int> matchFeatures(const Features& from, const Features& to);

/// A frame with its features, to be matched with frames far from it.
struct DescribedFrame {
  FramePtr frame;
  float gain = 1;  ///< applied to its intensities
  Features features;
  std::vector<Eigen::Vector2f> positions;  ///< of the features [px]
  cv::Mat valid;                           ///< mask; empty: all pixels are
};

/// @param gain applied to the intensities
DescribedFrame describeFrame(FramePtr frame, float gain);

/// Index of the partner of each feature of `from` in `to`, -1 without one: those whose descriptors
/// are each other's nearest, then those that the descriptors near the place tell that their
/// neighbours' motion predicts. The image of `from` is not looked at.
std::vector<int> findPartners(const DescribedFrame& from, const DescribedFrame& to);

/// Where a frame shows the features of another one that have a partner. Lucas-Kanade moves all of
/// them by a fraction of a pixel, forward and back again. Runs in parallel inside the caller's
/// arena; the result does not depend on the number of threads.
/// @return by feature of `from`; NaN where it was not found [px]
std::vector<Eigen::Vector2f> findAgain(const DescribedFrame& from, const DescribedFrame& to);

}  // namespace dsorb
