// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/calibration.h"
#include "dsorb/image/frame.h"

#include <cstddef>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

namespace dsorb {

/// Channels of a raw pixel and their type; 16-bit values are in the machine's byte order.
enum class PixelFormat { kGrey8, kGrey16, kBgr8, kRgb8 };

/// Non-owning view of an image as a camera gives it: rows of whole pixels, channels interleaved.
struct RawImage {
  const void* data = nullptr;                ///< first row, not owned
  int width = 0;                             ///< [px]
  int height = 0;                            ///< [px]
  PixelFormat format = PixelFormat::kGrey8;  ///< format of all pixels
  std::size_t stride_bytes = 0;              ///< distance between rows; 0: contiguous
};

/// View of a `cv::Mat` of type CV_8UC1, CV_16UC1 or CV_8UC3 (BGR), or of anything with its members.
/// @throws std::invalid_argument on another type
template <typename Matrix>
[[nodiscard]] RawImage rawImage(const Matrix& matrix) {
  constexpr int kGrey8 = 0;  // values of OpenCV's CV_8UC1, CV_16UC1, CV_8UC3
  constexpr int kGrey16 = 2;
  constexpr int kBgr8 = 16;
  const int type = matrix.type();
  if (type != kGrey8 && type != kGrey16 && type != kBgr8) {
    throw std::invalid_argument("matrix of type " + std::to_string(type) +
                                ": CV_8UC1, CV_16UC1 or CV_8UC3 is expected");
  }
  const PixelFormat format = type == kGrey8    ? PixelFormat::kGrey8
                             : type == kGrey16 ? PixelFormat::kGrey16
                                               : PixelFormat::kBgr8;
  return {matrix.data, matrix.cols, matrix.rows, format, static_cast<std::size_t>(matrix.step)};
}

/// Turns raw images of a camera into frames: grey levels, photometric correction, mask,
/// undistortion, pyramid. One thread at a time may use it.
class Rectifier {
 public:
  /// @param calibration from a file (`readCalibration` of dsorb/io/calibration_reader.h) or from
  ///        numbers; the lens needs the size of the images. Without response and vignette grey
  ///        levels stay as they are; of the two, one may be missing.
  /// @throws std::invalid_argument where the lens is none that a camera can have, the size is
  ///         missing or too small, or the rectification asked for is impossible
  explicit Rectifier(const Calibration& calibration);
  ~Rectifier();
  Rectifier(Rectifier&&) noexcept;             ///< the other may only be destroyed or assigned to
  Rectifier& operator=(Rectifier&&) noexcept;  ///< the other may only be destroyed or assigned to

  /// Camera of the frames. Its size is cropped on the right and at the bottom to multiples of 16.
  [[nodiscard]] const PinholeCamera& camera() const;
  [[nodiscard]] int inputWidth() const;   ///< [px]
  [[nodiscard]] int inputHeight() const;  ///< [px]
  /// What is odd about the calibration, one sentence each.
  [[nodiscard]] const std::vector<std::string>& warnings() const;

  /// Bits that values of 16-bit images take, 9 to 16; 16 before.
  /// @throws std::invalid_argument out of that range
  void setBits(int bits);

  /// Pixels that no image sees: the camera's own vehicle, a time stamp. It is copied.
  /// @param mask 8-bit, of the input's size, below 128 where pixels are invalid; empty: none
  /// @throws std::invalid_argument on another type or size, or where it leaves no pixel
  void setMask(const ImageView& mask);

  /// @param image of the input's size
  /// @param mask  of this image alone, as for setMask(); both apply
  /// @return of camera()'s size, NaN where invalid; valid until the next call
  /// @throws std::invalid_argument where the image is empty, of another size, or its stride shorter
  ///         than a row
  ImageView rectify(const RawImage& image, const ImageView& mask = {});

  /// The rectified image with its pyramid.
  /// @param info `response_slope` is set where the response is known, `row_times` where the
  ///             lens has a readout
  /// @throws std::invalid_argument as rectify()
  FramePtr frame(const RawImage& image, FrameInfo info, const ImageView& mask = {});

  /// Slope of the response for FrameInfo; null where the response is not known.
  [[nodiscard]] const std::shared_ptr<const ResponseSlope>& responseSlope() const;
  /// Row times for FrameInfo; null without a readout.
  [[nodiscard]] const std::shared_ptr<const RowTimes>& rowTimes() const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace dsorb
