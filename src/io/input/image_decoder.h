// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace dsorb {

/// Largest image file that is read.
inline constexpr std::uintmax_t kMaxImageBytes = std::uintmax_t{1} << 28;
/// Most pixels that are decoded.
inline constexpr std::int64_t kMaxPixels = std::int64_t{1} << 26;

/// @throws IoError where the file cannot be read
std::vector<std::uint8_t> readFile(const std::filesystem::path& file);

/// Decodes PNG, JPEG, PNM, BMP, TIFF and WebP to one grey channel of 8 or 16 bits, as stored.
/// @param name of the file, for messages
/// @throws IoError where the bytes are no image, are truncated, have another depth, or
///         more than kMaxPixels, which of a PNG or JPEG is told before they are decoded
cv::Mat decodeGrey(const std::vector<std::uint8_t>& bytes, const std::string& name);

/// Suffix of a file in lower case, with its dot.
std::string lowerSuffix(const std::filesystem::path& file);

/// Whether a file is taken for an image, by its suffix.
bool hasImageSuffix(const std::filesystem::path& file);

}  // namespace dsorb
