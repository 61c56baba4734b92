// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core/mat.hpp>

#include <optional>

namespace dsorb {

/// Whether a grey image of 8 or 16 bits is a mosaic of colours (Bayer): in many of its blocks the
/// pixels of one diagonal of every 2x2 are brighter than those of the other.
/// @return empty where it is too dark to tell
[[nodiscard]] std::optional<bool> isMosaic(const cv::Mat& image);

/// Grey of a mosaic, whatever its first colour is: each pixel becomes (red + 2 green + blue) / 4 of
/// its 3x3 neighbours, by weights 1 2 1 either way, at its place.
[[nodiscard]] cv::Mat greyOfMosaic(const cv::Mat& image);

/// Whether the rows of an image of 8 bits, grey or BGR, are of two moments in turn: in many of its
/// blocks neighbouring rows differ more than those of one moment do.
[[nodiscard]] bool isInterlaced(const cv::Mat& image);

}  // namespace dsorb
