// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/frame.h"

#include "features/features.h"

#include <Eigen/Core>
#include <opencv2/core.hpp>

#include <vector>

namespace dsorb {

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
