// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core/mat.hpp>

#include <memory>
#include <string>

namespace dsorb {

/// Images of a video file, device or address, one after the other, by OpenCV's videoio.
class Capture {
 public:
  /// @throws IoError where nothing that decodes is there, or this build has no videoio
  explicit Capture(const std::string& address);
  ~Capture();
  Capture(const Capture&) = delete;
  Capture& operator=(const Capture&) = delete;

  /// Goes to the next image. @return false where there is none
  bool grab();
  /// The image that was grabbed: 8 bits BGR, upright. @return false where it cannot be decoded
  bool retrieve(cv::Mat& image);
  /// Of the image that was grabbed, from the container [s]; increases always.
  [[nodiscard]] double time() const { return time_; }
  /// Of the images [1/s]; 30 where the container does not say it.
  [[nodiscard]] double rate() const { return rate_; }
  /// Number of images that the container announces; 0: none.
  [[nodiscard]] int announced() const { return announced_; }

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
  double time_ = 0;
  double rate_ = 0;
  int announced_ = 0;
  bool begun_ = false;
};

}  // namespace dsorb
