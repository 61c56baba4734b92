// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "io/input/image_source.h"

#include <opencv2/core.hpp>

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace dsorb {

/// Images of a video file, device or address, one after the other.
class Capture {
 public:
  virtual ~Capture() = default;

  /// Goes to the next image. @return false where there is none
  virtual bool grab() = 0;
  /// The image that was grabbed: 8 bits BGR, upright, and how it was turned for that.
  /// @return false where it cannot be decoded
  virtual bool retrieve(SourceImage& image) = 0;
  /// Time of the image that was grabbed, from the container [s]; it always increases.
  [[nodiscard]] virtual double time() const { return 0; }
  /// Rate of the images [1/s]; 30 where the container does not say it.
  [[nodiscard]] virtual double rate() const { return 0; }
  /// Number of images as the container tells or as its length and rate let one guess; 0: unknown.
  [[nodiscard]] virtual int announced() const { return 0; }
  /// After the last image: the share of its length that the container announces and does not have,
  /// sound included; 0 where nothing is announced but guesses.
  [[nodiscard]] virtual double missingShare() const { return 0; }
  /// What is to be said since the last call, for one sentence behind the name of the image.
  [[nodiscard]] virtual std::string takeDoubts() { return {}; }
};

/// Turns an image clockwise by 0, 90, 180 or 270 degrees.
[[nodiscard]] inline cv::Mat turned(const cv::Mat& image, int degrees) {
  cv::Mat result = image;
  if (degrees > 0) cv::rotate(image, result, cv::ROTATE_90_CLOCKWISE + degrees / 90 - 1);
  return result;
}

/// What OpenCV's imgcodecs and videoio and FFmpeg's libraries read. The libraries that these bring
/// along take 50 MiB of memory and .1 s to load: where ours are shared ones, a module of its own is
/// linked with them, which is loaded at the first call.

/// Decodes an image of any format that OpenCV knows to one grey channel, as stored.
/// @return empty where it cannot
/// @throws IoError where the module is missing
cv::Mat decodeByOpenCv(const std::vector<std::uint8_t>& bytes);

/// Opens a video file, device or address.
/// @throws IoError where nothing that decodes is there, this build cannot read it or the module is
///         missing
std::unique_ptr<Capture> openCapture(const std::string& address);

/// Functions of the module that is linked with OpenCV's imgcodecs and videoio, and with FFmpeg. It
/// is linked with no library of ours, so they throw none of our errors.
struct CodecsModule {
  /// @return empty where it cannot
  cv::Mat (*decode)(const std::vector<std::uint8_t>& bytes);
  /// @return null where nothing that decodes is there, and `why`
  std::unique_ptr<Capture> (*open_capture)(const std::string& address, std::string& why);
};

/// Opens a video file, or an address like rtsp://..., by FFmpeg's libraries.
/// @param why what is wrong, where nothing that decodes is there
/// @return null where nothing that decodes is there
std::unique_ptr<Capture> openFfmpegCapture(const std::string& address, std::string& why);

}  // namespace dsorb

extern "C" __attribute__((visibility("default"))) const dsorb::CodecsModule* dsorbCodecsModule();
