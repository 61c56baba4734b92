// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "io/input/capture.h"

#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace dsorb {

/// What OpenCV's imgcodecs and videoio and FFmpeg's libraries read. The libraries that these bring
/// along take 50 MiB of memory and .1 s to load: where ours are shared ones, a module of its own is
/// linked with them, which is loaded at the first call.

/// Decodes an image of any format that OpenCV knows to one grey channel, as stored.
/// @return empty where it cannot
/// @throws IoError where the module is missing
cv::Mat decodeByOpenCv(const std::vector<std::uint8_t>& bytes);

/// Opens a video file, device or address.
/// @throws IoError where nothing that decodes is there, this build cannot read it or the module is
///         missing
std::unique_ptr<Capture> openCapture(const std::string& address);

}  // namespace dsorb
