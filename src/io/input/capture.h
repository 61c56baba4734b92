// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>

#include <string>

namespace dsorb {

/// Images of a video file, device or address, one after the other.
class Capture {
 public:
  virtual ~Capture() = default;

  /// Goes to the next image. @return false where there is none
  virtual bool grab() = 0;
  /// The image that was grabbed: 8 bits BGR, upright. @return false where it cannot be decoded
  virtual bool retrieve(cv::Mat& image) = 0;
  /// Time of the image that was grabbed, from the container [s]; it always increases.
  [[nodiscard]] virtual double time() const = 0;
  /// Rate of the images [1/s]; 30 where the container does not say it.
  [[nodiscard]] virtual double rate() const = 0;
  /// Number of images as the container tells or as its length and rate let one guess; 0: unknown.
  [[nodiscard]] virtual int announced() const = 0;
  /// How far images are turned clockwise to be upright: 0, 90, 180 or 270 degrees.
  [[nodiscard]] virtual int turn() const = 0;
  /// Width of a pixel over its height, of upright images.
  [[nodiscard]] virtual double pixelAspect() const { return 1; }
  /// After the last image: the share of its length that the container announces and does not have,
  /// sound included; 0 where nothing is announced but guesses.
  [[nodiscard]] virtual double missingShare() const { return 0; }
  /// What is to be said since the last call, for one sentence behind the name of the image.
  [[nodiscard]] virtual std::string takeDoubts() { return {}; }
};

/// Turns an image clockwise by 0, 90, 180 or 270 degrees.
[[nodiscard]] inline cv::Mat turned(const cv::Mat& image, int degrees) {
  cv::Mat result = image;
  if (degrees == 90) cv::rotate(image, result, cv::ROTATE_90_CLOCKWISE);
  if (degrees == 180) cv::rotate(image, result, cv::ROTATE_180);
  if (degrees == 270) cv::rotate(image, result, cv::ROTATE_90_COUNTERCLOCKWISE);
  return result;
}

}  // namespace dsorb
