// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/frame.h"

#include "image/photometric.h"

#include <Eigen/Core>
#include <opencv2/core.hpp>

namespace dsorb {

/// Features keep this distance from the border of the image [px]; the pattern and its interpolation
/// stay inside.
constexpr int kFeatureBorder = kPatternRadius + 1;

/// What OpenCV sees of a frame.
struct GreyImage {
  cv::Mat grey;   ///< 8 bit, invalid pixels black
  cv::Mat valid;  ///< 255 where the pixel and all its neighbours are valid; empty when all are

  /// Whether a feature can be there: away from the border and from invalid pixels.
  [[nodiscard]] bool usable(const cv::Point2f& position) const;
};

/// @param gain   applied to the intensities
/// @param margin by which invalid regions are widened [px]
GreyImage greyImage(const PyramidLevel& level, float gain, int margin);

/// 255 where a pixel and all its neighbours up to `margin` [px] are valid.
cv::Mat validMask(const PyramidLevel& level, int margin);

/// Whether a feature can be there: away from the border and from invalid pixels.
/// @param valid mask; empty: all are
bool isUsable(const Eigen::Vector2f& position, cv::Size size, const cv::Mat& valid);

/// Mean intensity of the valid pixels [grey levels], from a coarse level; 0 without any.
double meanIntensity(const Frame& frame);

/// Gain that brings a frame to a mean intensity: Lucas-Kanade expects equal brightness. At most two
/// stops; more is another scene or an image without content.
float gainTowards(double mean_intensity, const Frame& frame);

}  // namespace dsorb
