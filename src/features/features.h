// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "features/grey_image.h"

#include <Eigen/Core>
#include <opencv2/core.hpp>

#include <cmath>
#include <vector>

namespace dsorb {

constexpr float kMaxRefinement = 4;  ///< a match that moves farther when it is refined goes [px]
/// Least smaller eigenvalue of the gradient tensor of a match [grey levels^2 / px^2].
constexpr double kMinTexture = 0.1;

/// Features of one image, the strongest first.
struct Features {
  std::vector<cv::KeyPoint> points;
  cv::Mat descriptors;  ///< a row each: 32 bytes
};

/// Strongest first; position decides between equals, so that the order is the same everywhere.
inline bool stronger(const cv::KeyPoint& a, const cv::KeyPoint& b) {
  if (a.response != b.response) return a.response > b.response;
  if (a.pt.y != b.pt.y) return a.pt.y < b.pt.y;
  return a.pt.x < b.pt.x;
}

constexpr int kMaxFeatures = 2000;  ///< of an image

/// Whether a feature was found; positions of those that were not are NaN.
inline bool isSeen(const Eigen::Vector2f& position) {
  return std::isfinite(position.x());
}

}  // namespace dsorb
