// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <optional>
#include <string>

namespace dsorb {

/// How many bits the values of 16-bit images take, and what the user should know of it.
struct BitDepth {
  int bits = 16;
  std::string warning;  ///< empty: none
};

/// Cameras of 10 and 12 bits write 16-bit files; taken for what the type can hold, their images
/// are nearly black.
/// @param largest of the values of several images
[[nodiscard]] BitDepth recogniseBitDepth(std::uint16_t largest);

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

/// Bars beside a picture of another shape than the image's (letterbox, pillarbox) [px].
struct BlackBars {
  int left = 0;
  int right = 0;
  int top = 0;
  int bottom = 0;

  [[nodiscard]] bool any() const { return left > 0 || right > 0 || top > 0 || bottom > 0; }
};

/// What stays black in all images of a sequence, at opposite sides alike. The edge of such a bar
/// never moves and would bend any map.
class BarFinder {
 public:
  /// Looks at the next image; of other than 8 bits nothing is known.
  /// @return whether the bars have changed, as with the first image that has some
  bool look(const cv::Mat& image);
  [[nodiscard]] const BlackBars& bars() const { return bars_; }

 private:
  BlackBars bars_;
  bool begun_ = false;
};

/// 0 where a mask hides, in the bars or beside them, where compression blurs their edge.
/// @param mask of the sequence; empty: none
[[nodiscard]] cv::Mat withoutBars(const BlackBars& bars, cv::Size size, const cv::Mat& mask);

/// What the user is told of the bars.
[[nodiscard]] std::string describe(const BlackBars& bars);

}  // namespace dsorb
