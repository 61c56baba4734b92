// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <string>
#include <vector>

namespace dsorb {

/// Whether the bytes begin as those of a PNG.
[[nodiscard]] bool isPng(const std::vector<std::uint8_t>& bytes);

/// Decodes a PNG to one grey channel of 8 or 16 bits, the same pixels as OpenCV's: colours are
/// weighed as those of Rec. 601, transparency is left out.
/// @param name of the file, for messages
/// @throws IoError with the words of libpng where the file is truncated or damaged
[[nodiscard]] cv::Mat decodePng(const std::vector<std::uint8_t>& bytes, const std::string& name);

/// @param image grey of 8 or 16 bits, or BGR of 8 bits
/// @throws std::invalid_argument on an image of another type
[[nodiscard]] std::string encodePng(const cv::Mat& image);

}  // namespace dsorb
