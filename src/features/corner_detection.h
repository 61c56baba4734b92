// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>

#include <vector>

namespace dsorb {

/// A local maximum of the smaller eigenvalue of the gradient tensor.
struct DetectedCorner {
  float strength = 0;  ///< that eigenvalue, as cv::cornerMinEigenVal() scales it
  int x = 0;           ///< [px]
  int y = 0;           ///< [px]
};

/// Corners of an image, strongest first. Finds what cv::goodFeaturesToTrack() finds without a least
/// distance, but in bands of rows: in parallel inside the caller's arena, with the memory of a
/// band.
/// @param grey    8 bit
/// @param valid   0 where no corner can be; empty: nowhere
/// @param quality least strength relative to the strongest
/// @source Shi and Tomasi, Good Features to Track, CVPR 1994
std::vector<DetectedCorner> detectCorners(const cv::Mat& grey,
                                          const cv::Mat& valid,
                                          double quality);

}  // namespace dsorb
