// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/init/result.h"

#include "io/output/run_record.h"

#include <opencv2/core.hpp>

#include <filesystem>

namespace dsorb::io {

/// Level 0 of a frame as 8-bit image; pixels that are not valid are black.
[[nodiscard]] cv::Mat greyImage(const Frame& frame);

/// The reference image with its points, coloured by inverse depth: near red, far blue, with a
/// colour bar.
[[nodiscard]] cv::Mat drawInverseDepth(const InitializationResult& result);

/// Top view (x to the right, z up) of the trajectory and keyframes of the longest segment.
[[nodiscard]] cv::Mat drawTrajectory(const RunRecord& record);

/// Writes a PNG, replacing the file as a whole. @throws IoError
/// @param image grey of 8 or 16 bits, or BGR of 8 bits
void writePng(const std::filesystem::path& path, const cv::Mat& image);

}  // namespace dsorb::io
