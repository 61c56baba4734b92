// SPDX-License-Identifier: BSD-3-Clause
#include "io/capture.h"

#include "dsorb/error.h"

#include <fmt/format.h>

#ifdef DSORB_WITH_VIDEOIO

#include <opencv2/core.hpp>
#include <opencv2/core/utility.hpp>
#include <opencv2/videoio.hpp>
#include <opencv2/videoio/registry.hpp>

#include <algorithm>
#include <cmath>

namespace dsorb {
namespace {

constexpr double kUsualRate = 30;
constexpr double kMaxRate = 1e4;
constexpr double kMaxImages = 1e9;

/// OpenCV asks every backend where it is not told one, and each of them complains by itself.
int backendFor(const std::string& address) {
  if (address.rfind("/dev/video", 0) == 0) return cv::CAP_V4L2;
  return cv::videoio_registry::hasBackend(cv::CAP_FFMPEG) ? cv::CAP_FFMPEG : cv::CAP_ANY;
}

/// How far a picture is to be turned clockwise [degrees]: 0, 90, 180 or 270. OpenCV 4.6 tells it
/// the wrong way round (its issue 22088), so it must not turn pictures itself.
int turnOf(cv::VideoCapture& capture) {
  const int told = static_cast<int>(std::lround(capture.get(cv::CAP_PROP_ORIENTATION_META)));
  capture.set(cv::CAP_PROP_ORIENTATION_AUTO, 0);
  const bool reversed = cv::getVersionMajor() == 4 && cv::getVersionMinor() == 6;
  return ((reversed ? -told : told) % 360 + 360) % 360;
}

}  // namespace

class Capture::Impl {
 public:
  cv::VideoCapture capture;
  int turn = 0;  // clockwise [degrees]
};

Capture::Capture(const std::string& address) : impl_(std::make_unique<Impl>()) {
  bool open = false;
  try {
    open = impl_->capture.open(address, backendFor(address));
  } catch (const cv::Exception&) {
    open = false;
  }
  if (!open) {
    throw IoError(fmt::format(
        "{}: no video that can be decoded; expected a file, device or address with pictures",
        address));
  }
  impl_->turn = turnOf(impl_->capture);
  const double rate = impl_->capture.get(cv::CAP_PROP_FPS);
  rate_ = rate > 0 && rate < kMaxRate ? rate : kUsualRate;
  const double count = impl_->capture.get(cv::CAP_PROP_FRAME_COUNT);
  announced_ = count > 0 && count < kMaxImages ? static_cast<int>(std::lround(count)) : 0;
}

/// The last images of a stream that is reordered come without a time, and some containers have
/// none.
bool Capture::grab() {
  if (!impl_->capture.grab()) return false;
  const double time = 1e-3 * impl_->capture.get(cv::CAP_PROP_POS_MSEC);
  time_ = !begun_ || time > time_ ? time : time_ + 1 / rate_;
  begun_ = true;
  return true;
}

bool Capture::retrieve(cv::Mat& image) {
  if (!impl_->capture.retrieve(image) || image.empty()) return false;
  cv::Mat upright;
  if (impl_->turn == 90) cv::rotate(image, upright, cv::ROTATE_90_CLOCKWISE);
  if (impl_->turn == 180) cv::rotate(image, upright, cv::ROTATE_180);
  if (impl_->turn == 270) cv::rotate(image, upright, cv::ROTATE_90_COUNTERCLOCKWISE);
  if (!upright.empty()) image = upright;
  return true;
}

}  // namespace dsorb

#else

namespace dsorb {

class Capture::Impl {};

Capture::Capture(const std::string& address) {
  throw IoError(fmt::format(
      "{}: this build reads neither videos nor cameras: OpenCV's videoio was missing when it was "
      "configured (Debian: libopencv-videoio-dev)",
      address));
}
bool Capture::grab() {
  return false;
}
bool Capture::retrieve(cv::Mat& /*image*/) {
  return false;
}

}  // namespace dsorb

#endif

namespace dsorb {

Capture::~Capture() = default;

}  // namespace dsorb
