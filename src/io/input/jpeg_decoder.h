// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <string>
#include <vector>

namespace dsorb {

/// Whether the bytes begin as those of a JPEG.
[[nodiscard]] bool isJpeg(const std::vector<std::uint8_t>& bytes);

/// Decodes a JPEG to one grey channel of 8 bits. The same pixels as OpenCV's, but OpenCV fills what
/// is missing of a truncated or damaged file with grey and says so nowhere.
/// @param name of the file, for messages
/// @return empty where the file is intact but has four channels, which only OpenCV converts
/// @throws IoError with the words of libjpeg
[[nodiscard]] cv::Mat decodeJpeg(const std::vector<std::uint8_t>& bytes, const std::string& name);

}  // namespace dsorb
