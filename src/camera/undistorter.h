// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/calibration.h"

#include <cstdint>
#include <string>
#include <vector>

namespace dsorb {

/// Turns images of a lens into images of a pinhole camera. Maps are built once; afterwards safe to
/// use from several threads.
class Undistorter {
 public:
  /// @param lens          with the size of the input images
  /// @param rectification the camera to rectify for; its size is cropped to multiples of 16
  /// @throws std::invalid_argument where numbers are not finite, focal lengths not positive, sizes
  ///         below 16, `none` asks for another size, or `crop` finds no rectangle
  Undistorter(const Lens& lens, const Rectification& rectification);

  /// The rectified camera; its size is that of the output images.
  [[nodiscard]] const PinholeCamera& camera() const { return camera_; }
  [[nodiscard]] int inputWidth() const { return input_width_; }
  [[nodiscard]] int inputHeight() const { return input_height_; }

  /// Bilinear resampling; where the output is coarser than the input, the mean of several samples
  /// per pixel against aliasing.
  /// @param input  input size, rows contiguous [grey levels], NaN where invalid
  /// @param output size of camera(), rows contiguous; NaN where the pixel lies outside the input or
  ///               touches an invalid pixel
  void apply(const float* input, float* output) const;

 private:
  /// Cell of the input image and position within it; NaN positions mark invalid pixels.
  struct Sample {
    std::int32_t offset;
    float fx;
    float fy;
  };
  void buildMap(const Lens& lens);
  void chooseSamples(const Lens& lens);

  PinholeCamera camera_;
  int input_width_;
  int input_height_;
  int samples_x_ = 1;  // per output pixel
  int samples_y_ = 1;
  std::vector<Sample> map_;  // samples_x_ * samples_y_ per output pixel; empty: rows are copied
};

/// Refuses a lens that no camera can have.
/// @throws std::invalid_argument where the image would see more than a lens of its model can, or
///         where the distortion folds back or magnifies without measure in most of the image
void refuseImpossibleLens(const Lens& lens);

/// Describes what a calibration that is possible has against it, one sentence each: a principal
/// point far from the middle, a very narrow view, an output that stretches the image, a crop that
/// leaves little of it.
/// @param camera the rectified one
[[nodiscard]] std::vector<std::string> doubtsAbout(const Lens& lens,
                                                   RectificationMode mode,
                                                   const PinholeCamera& camera);

}  // namespace dsorb
