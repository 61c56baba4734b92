// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core/types.hpp>

#include <cstdint>
#include <optional>
#include <vector>

namespace dsorb {

/// Size of an image as its header tells it, without decoding: PNG, JPEG, PNM, BMP, TIFF or WebP.
/// @param bytes the file or its beginning
/// @return empty where it is none of these, or where the size does not stand in these bytes
[[nodiscard]] std::optional<cv::Size> sizeInHeader(const std::vector<std::uint8_t>& bytes);

}  // namespace dsorb
