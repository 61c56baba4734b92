// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "init/orb/tracks/lucas_kanade.h"

#include <opencv2/core.hpp>

#include <vector>

namespace dsorb::init_orb {

/// Follows points by cv::calcOpticalFlowPyrLK, stopping and refusing as LucasKanade does.
/// @param from, to 8-bit images of the same size
/// @param end      where the search begins; where `from` has them if it is empty. Gets the result.
/// @return         by point, whether it was found
std::vector<unsigned char> followWithOpenCv(const cv::Mat& from,
                                            const cv::Mat& to,
                                            const std::vector<cv::Point2f>& start,
                                            const LucasKanadeOptions& options,
                                            std::vector<cv::Point2f>& end);

}  // namespace dsorb::init_orb
