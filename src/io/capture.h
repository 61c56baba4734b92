// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core/mat.hpp>

namespace dsorb {

/// Images of a video file, device or address, one after the other.
class Capture {
 public:
  virtual ~Capture() = default;

  /// Goes to the next image. @return false where there is none
  virtual bool grab() = 0;
  /// The image that was grabbed: 8 bits BGR, upright. @return false where it cannot be decoded
  virtual bool retrieve(cv::Mat& image) = 0;
  /// Of the image that was grabbed, from the container [s]; increases always.
  [[nodiscard]] virtual double time() const = 0;
  /// Of the images [1/s]; 30 where the container does not say it.
  [[nodiscard]] virtual double rate() const = 0;
  /// Number of images that the container announces; 0: none.
  [[nodiscard]] virtual int announced() const = 0;
  /// How far images are turned clockwise to be upright: 0, 90, 180 or 270 degrees.
  [[nodiscard]] virtual int turn() const = 0;
};

}  // namespace dsorb
