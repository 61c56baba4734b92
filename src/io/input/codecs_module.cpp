// SPDX-License-Identifier: BSD-3-Clause
#include "io/input/codecs.h"

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#ifdef DSORB_WITH_VIDEOIO
#include <opencv2/videoio.hpp>
#endif

namespace dsorb {
namespace {

cv::Mat decode(const std::vector<std::uint8_t>& bytes) {
  try {
    return cv::imdecode(bytes,
                        cv::IMREAD_GRAYSCALE | cv::IMREAD_ANYDEPTH | cv::IMREAD_IGNORE_ORIENTATION);
  } catch (const cv::Exception&) {
    return {};
  }
}

#ifdef DSORB_WITH_VIDEOIO

/// A device of Video4Linux. Its times are of no use: whoever asks has a clock.
class Device final : public Capture {
 public:
  [[nodiscard]] bool open(const std::string& address) {
    try {
      return capture_.open(address, cv::CAP_V4L2);
    } catch (const cv::Exception&) {
      return false;
    }
  }
  bool grab() override { return capture_.grab(); }
  bool retrieve(SourceImage& image) override {
    return capture_.retrieve(image.pixels) && !image.pixels.empty();
  }

 private:
  cv::VideoCapture capture_;
};

std::unique_ptr<Capture> openDevice(const std::string& address, std::string& why) {
  auto device = std::make_unique<Device>();
  if (device->open(address)) return device;
  why = "no video that can be decoded";
  return nullptr;
}

#else

std::unique_ptr<Capture> openDevice(const std::string& /*address*/, std::string& why) {
  why =
      "this build reads no cameras: OpenCV's videoio was missing when it was configured (Debian: "
      "libopencv-videoio-dev)";
  return nullptr;
}

#endif

std::unique_ptr<Capture> openCapture(const std::string& address, std::string& why) {
  const bool device = address.rfind("/dev/video", 0) == 0;
  return device ? openDevice(address, why) : openFfmpegCapture(address, why);
}

constexpr CodecsModule kModule{&decode, &openCapture};

}  // namespace

#ifndef DSORB_WITH_FFMPEG

std::unique_ptr<Capture> openFfmpegCapture(const std::string& /*address*/, std::string& why) {
  why =
      "this build reads no videos: FFmpeg's libraries were missing when it was configured (Debian: "
      "libavformat-dev libswscale-dev)";
  return nullptr;
}

#endif

}  // namespace dsorb

const dsorb::CodecsModule* dsorbCodecsModule() {
  return &dsorb::kModule;
}
