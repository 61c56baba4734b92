// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/camera/rectifier.h"

#include "camera/image_size.h"
#include "camera/photometric_correction.h"
#include "camera/undistorter.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace dsorb {
namespace {

constexpr std::uint8_t kValidMask = 128;  // and above; lossy masks are not exactly 0 and 255

std::size_t bytesOf(PixelFormat format) {
  switch (format) {
    case PixelFormat::kGrey16:
      return 2;
    case PixelFormat::kBgr8:
    case PixelFormat::kRgb8:
      return 3;
    case PixelFormat::kGrey8:
      break;
  }
  return 1;
}

std::size_t pixelsOf(int width, int height) {
  return static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
}

/// Where one of response and vignette is known, the other counts as ideal.
PhotometricCorrection correctionFor(const Calibration& calibration) {
  const int width = calibration.lens.width;
  const int height = calibration.lens.height;
  PhotometricCalibration photometric = calibration.photometric;
  if (photometric.response.empty() && photometric.vignette.empty()) return {width, height};
  if (photometric.response.empty()) {
    for (int level = 0; level < 256; ++level) {
      photometric.response.push_back(static_cast<float>(level));
    }
  }
  if (photometric.vignette.empty()) {
    photometric.vignette.assign(pixelsOf(width, height), 1);
    photometric.vignette_width = width;
    photometric.vignette_height = height;
  }
  return {photometric, width, height};
}

/// Rec. 601 luma of interleaved pixels, rounded.
/// @param red, blue positions of the channels in a pixel
void convertToGrey(
    const RawImage& image, std::size_t stride, int red, int blue, std::uint8_t* grey) {
  const auto* row = static_cast<const std::uint8_t*>(image.data);
  for (int y = 0; y < image.height; ++y, row += stride) {
    const std::uint8_t* pixel = row;
    for (int x = 0; x < image.width; ++x, pixel += 3) {
      const unsigned sum = 19595U * pixel[red] + 38470U * pixel[1] + 7471U * pixel[blue];
      *grey++ = static_cast<std::uint8_t>((sum + 32768U) >> 16U);
    }
  }
}

/// What is left to Undistorter: numbers that are not finite.
const Lens& checked(const Lens& lens) {
  if (lens.width <= 0 || lens.height <= 0) {
    throw std::invalid_argument(
        "the lens has no image size; set its width and height to those of the images");
  }
  if (std::isfinite(lens.fx * lens.fy) && lens.fx > 0 && lens.fy > 0) refuseImpossibleLens(lens);
  return lens;
}

}  // namespace

class Rectifier::Impl {
 public:
  explicit Impl(const Calibration& calibration)
      : undistorter_(checked(calibration.lens), calibration.rectification),
        correction_(correctionFor(calibration)),
        corrected_(pixelsOf(undistorter_.inputWidth(), undistorter_.inputHeight())),
        rectified_(pixelsOf(undistorter_.camera().width, undistorter_.camera().height)) {
    warnings_ =
        doubtsAbout(calibration.lens, calibration.rectification.mode, undistorter_.camera());
    if (calibration.lens.readout.isRolling()) {
      const bool resampled = calibration.rectification.mode != RectificationMode::kNone;
      row_times_ = std::make_shared<const RowTimes>(
          dsorb::rowTimes(calibration.lens, undistorter_.camera(), resampled));
    }
    if (calibration.photometric.response.empty()) return;
    response_slope_ = std::make_shared<const ResponseSlope>(correction_.responseSlope());
  }

  void setBits(int bits) {
    if (bits < 9 || bits > 16) {
      throw std::invalid_argument(std::to_string(bits) + " bits: 9 to 16 are expected");
    }
    correction_.setBits(bits);
  }

  void setMask(const ImageView& mask) {
    std::vector<std::uint8_t> pixels;
    if (!mask.empty()) {
      checkMask(mask);
      for (int y = 0; y < mask.height(); ++y) {
        const auto* row = mask.row<std::uint8_t>(y);
        pixels.insert(pixels.end(), row, row + mask.width());
      }
      if (std::none_of(pixels.begin(), pixels.end(), [](auto m) { return m >= kValidMask; })) {
        throw std::invalid_argument("the mask is black everywhere; pixels to be used are white");
      }
    }
    mask_ = std::move(pixels);
  }

  ImageView rectify(const RawImage& image, const ImageView& mask) {
    const std::size_t stride = checkImage(image);
    if (!mask.empty()) checkMask(mask);
    correct(image, stride);
    if (!mask_.empty()) apply(ImageView(mask_.data(), image.width, image.height));
    if (!mask.empty()) apply(mask);
    undistorter_.apply(corrected_.data(), rectified_.data());
    return {rectified_.data(), undistorter_.camera().width, undistorter_.camera().height};
  }

  [[nodiscard]] const Undistorter& undistorter() const { return undistorter_; }
  [[nodiscard]] const std::vector<std::string>& warnings() const { return warnings_; }
  [[nodiscard]] const std::shared_ptr<const ResponseSlope>& responseSlope() const {
    return response_slope_;
  }
  [[nodiscard]] const std::shared_ptr<const RowTimes>& rowTimes() const { return row_times_; }

 private:
  [[nodiscard]] std::string inputSize() const {
    return sizeText(undistorter_.inputWidth(), undistorter_.inputHeight());
  }
  [[nodiscard]] bool isInputSize(int width, int height) const {
    return width == undistorter_.inputWidth() && height == undistorter_.inputHeight();
  }

  /// @return distance between rows [bytes]
  [[nodiscard]] std::size_t checkImage(const RawImage& image) const {
    if (image.data == nullptr) throw std::invalid_argument("the image is empty");
    if (!isInputSize(image.width, image.height)) {
      throw std::invalid_argument("an image of " + sizeText(image.width, image.height) +
                                  " px: expected " + inputSize() + " as calibrated");
    }
    const std::size_t row = bytesOf(image.format) * static_cast<std::size_t>(image.width);
    const std::size_t stride = image.stride_bytes == 0 ? row : image.stride_bytes;
    const bool whole = image.format != PixelFormat::kGrey16 || stride % 2 == 0;
    if (stride < row || !whole) {
      throw std::invalid_argument("stride of " + std::to_string(stride) +
                                  " bytes: expected whole pixels, at least the " +
                                  std::to_string(row) + " bytes of a row");
    }
    return stride;
  }

  void checkMask(const ImageView& mask) const {
    if (mask.type() != ImageView::Type::kUint8) {
      throw std::invalid_argument("the mask is not of 8 bits");
    }
    if (!isInputSize(mask.width(), mask.height())) {
      throw std::invalid_argument("a mask of " + sizeText(mask.width(), mask.height()) +
                                  " px: expected the size of the images, " + inputSize());
    }
  }

  void correct(const RawImage& image, std::size_t stride) {
    switch (image.format) {
      case PixelFormat::kGrey8:
        correction_.apply(static_cast<const std::uint8_t*>(image.data), stride, corrected_.data());
        return;
      case PixelFormat::kGrey16:
        correction_.apply(static_cast<const std::uint16_t*>(image.data), stride, corrected_.data());
        return;
      case PixelFormat::kBgr8:
      case PixelFormat::kRgb8:
        break;
    }
    grey_.resize(corrected_.size());
    const int red = image.format == PixelFormat::kRgb8 ? 0 : 2;
    convertToGrey(image, stride, red, 2 - red, grey_.data());
    correction_.apply(grey_.data(), static_cast<std::size_t>(image.width), corrected_.data());
  }

  void apply(const ImageView& mask) {
    float* pixel = corrected_.data();
    for (int y = 0; y < mask.height(); ++y) {
      const auto* row = mask.row<std::uint8_t>(y);
      for (int x = 0; x < mask.width(); ++x, ++pixel) {
        if (row[x] < kValidMask) *pixel = std::numeric_limits<float>::quiet_NaN();
      }
    }
  }

  Undistorter undistorter_;
  PhotometricCorrection correction_;
  std::vector<std::string> warnings_;
  std::shared_ptr<const ResponseSlope> response_slope_;
  std::shared_ptr<const RowTimes> row_times_;
  std::vector<std::uint8_t> mask_;  // input size; empty: none
  std::vector<std::uint8_t> grey_;  // scratch, input size, of colour images
  std::vector<float> corrected_;    // scratch, input size
  std::vector<float> rectified_;    // scratch, output size
};

Rectifier::Rectifier(const Calibration& calibration) : impl_(std::make_unique<Impl>(calibration)) {}
Rectifier::~Rectifier() = default;
Rectifier::Rectifier(Rectifier&&) noexcept = default;
Rectifier& Rectifier::operator=(Rectifier&&) noexcept = default;

const PinholeCamera& Rectifier::camera() const {
  return impl_->undistorter().camera();
}
int Rectifier::inputWidth() const {
  return impl_->undistorter().inputWidth();
}
int Rectifier::inputHeight() const {
  return impl_->undistorter().inputHeight();
}
const std::vector<std::string>& Rectifier::warnings() const {
  return impl_->warnings();
}
void Rectifier::setBits(int bits) {
  impl_->setBits(bits);
}
void Rectifier::setMask(const ImageView& mask) {
  impl_->setMask(mask);
}
ImageView Rectifier::rectify(const RawImage& image, const ImageView& mask) {
  return impl_->rectify(image, mask);
}
FramePtr Rectifier::frame(const RawImage& image, FrameInfo info, const ImageView& mask) {
  if (responseSlope()) info.response_slope = responseSlope();
  if (rowTimes()) info.row_times = rowTimes();
  return Frame::create(rectify(image, mask), info);
}
const std::shared_ptr<const ResponseSlope>& Rectifier::responseSlope() const {
  return impl_->responseSlope();
}
const std::shared_ptr<const RowTimes>& Rectifier::rowTimes() const {
  return impl_->rowTimes();
}

}  // namespace dsorb
