// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/error.h"

#include <opencv2/core/mat.hpp>

#include <cstddef>
#include <optional>
#include <string>

namespace dsorb {

/// Images of a camera that wait for a late caller, as many as drivers of Video4Linux usually hold;
/// the oldest is dropped for one too many.
inline constexpr std::size_t kCameraBuffers = 4;

/// One image as it is stored or sent.
struct SourceImage {
  int index = 0;
  cv::Mat pixels;                   ///< 8 or 16 bits of grey, or 8 bits of BGR
  std::optional<double> timestamp;  ///< [s]; empty: the data set says it
  std::string warning;              ///< one sentence; empty: none
  bool late = false;                ///< the image behind it is there, too: of a camera
  /// How far the sensor's image was turned clockwise to be upright: 0, 90, 180 or 270 degrees.
  int turn = 0;
  double pixel_aspect = 1;  ///< width of a pixel over its height
};

/// What an image of another size than that of the calibration is refused with.
[[nodiscard]] IoError wrongSize(const std::string& name, cv::Size size, cv::Size expected);

/// Where images come from: files, an archive, a video, a camera. One thread at a time uses it.
class ImageSource {
 public:
  virtual ~ImageSource() = default;
  /// Number of images; of a video as its container announces it, of a camera 0.
  [[nodiscard]] virtual int size() const = 0;
  /// Name of an image, for messages and reports.
  [[nodiscard]] virtual std::string name(int index) const = 0;
  /// The image of this position. A video goes forwards only; a camera gives the oldest of its
  /// images that wait, which is not that of the position. The last one may be asked for again.
  /// @return empty after the last image
  /// @throws IoError where it cannot be read
  [[nodiscard]] virtual std::optional<SourceImage> image(int index) = 0;
  /// Goes to the first image at least so many seconds after the first one, where times come with
  /// the images: in a video.
  /// @return its index; that after the last one where there is none
  [[nodiscard]] virtual int seek(double /*seconds*/) { return 0; }
  /// All images have this size: one of another may be refused before it is decoded.
  virtual void expect(cv::Size /*size*/) {}
  /// Images that a camera gave and that were dropped for newer ones before they were asked for.
  [[nodiscard]] virtual int dropped() const { return 0; }
};

}  // namespace dsorb
