// SPDX-License-Identifier: BSD-3-Clause
#include "io/codecs_module.h"

#include <opencv2/core.hpp>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgcodecs.hpp>

#ifdef DSORB_WITH_VIDEOIO
#include <opencv2/videoio.hpp>
#include <opencv2/videoio/registry.hpp>
#endif

#include <cmath>

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

constexpr double kUsualRate = 30;
constexpr double kMaxRate = 1e4;
constexpr double kMaxImages = 1e9;
// For opening [ms]: FFmpeg looks for up to 5 s at what a stream holds.
constexpr int kOpeningPatience = 10000;
constexpr int kReadingPatience = 5000;  // for an image [ms]

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

class OpenCvCapture final : public Capture {
 public:
  explicit OpenCvCapture(const cv::VideoCapture& capture)
      : capture_(capture), turn_(turnOf(capture_)) {
    const double rate = capture_.get(cv::CAP_PROP_FPS);
    rate_ = rate > 0 && rate < kMaxRate ? rate : kUsualRate;
    const double count = capture_.get(cv::CAP_PROP_FRAME_COUNT);
    announced_ = count > 0 && count < kMaxImages ? static_cast<int>(std::lround(count)) : 0;
  }

  /// The last images of a stream that is reordered come without a time, and some containers have
  /// none.
  bool grab() override {
    if (!capture_.grab()) return false;
    const double time = 1e-3 * capture_.get(cv::CAP_PROP_POS_MSEC);
    time_ = !begun_ || time > time_ ? time : time_ + 1 / rate_;
    begun_ = true;
    return true;
  }

  [[nodiscard]] int turn() const override { return turn_; }

  bool retrieve(cv::Mat& image) override {
    if (!capture_.retrieve(image) || image.empty()) return false;
    cv::Mat upright;
    if (turn_ == 90) cv::rotate(image, upright, cv::ROTATE_90_CLOCKWISE);
    if (turn_ == 180) cv::rotate(image, upright, cv::ROTATE_180);
    if (turn_ == 270) cv::rotate(image, upright, cv::ROTATE_90_COUNTERCLOCKWISE);
    if (!upright.empty()) image = upright;
    return true;
  }

  [[nodiscard]] double time() const override { return time_; }
  [[nodiscard]] double rate() const override { return rate_; }
  [[nodiscard]] int announced() const override { return announced_; }

 private:
  cv::VideoCapture capture_;
  int turn_;  // clockwise [degrees]
  double time_ = 0;
  double rate_ = 0;
  int announced_ = 0;
  bool begun_ = false;
};

/// Only FFmpeg takes these; its own are 30 s.
std::vector<int> timeoutsFor(int backend) {
  if (backend != cv::CAP_FFMPEG) return {};
  return {cv::CAP_PROP_OPEN_TIMEOUT_MSEC,
          kOpeningPatience,
          cv::CAP_PROP_READ_TIMEOUT_MSEC,
          kReadingPatience};
}

std::unique_ptr<Capture> openVideoCapture(const std::string& address) {
  cv::VideoCapture capture;
  const int backend = backendFor(address);
  try {
    if (!capture.open(address, backend, timeoutsFor(backend))) return nullptr;
  } catch (const cv::Exception&) {
    return nullptr;
  }
  return std::make_unique<OpenCvCapture>(capture);
}

constexpr CodecsModule kModule{&decode, &openVideoCapture};

#else

constexpr CodecsModule kModule{&decode, nullptr};

#endif

}  // namespace
}  // namespace dsorb

const dsorb::CodecsModule* dsorbCodecsModule() {
  return &dsorb::kModule;
}
