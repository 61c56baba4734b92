// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/error.h"

#include "io/input/codecs.h"
#include "io/input/image_source.h"
#include "io/text_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <deque>
#include <exception>
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <utility>

namespace dsorb {
namespace {

constexpr double kMissingShare = 0.1;  // of the announced length that may be missing
constexpr int kFewImages = 2;
constexpr double kUnevenStep = 1.5;  // times the usual one

class VideoFile : public ImageSource {
 public:
  explicit VideoFile(const std::filesystem::path& file)
      : file_(file.string()), capture_(openCapture(file_)) {
    if (!capture_->grab()) {
      throw fileError(file_, "holds no image that can be decoded");
    }
    begin_ = capture_->time();
    takeDoubts();
  }

  [[nodiscard]] int size() const override { return std::max(capture_->announced(), 1); }
  [[nodiscard]] double rate() const override { return capture_->rate(); }
  [[nodiscard]] double begin() const override { return begin_; }
  [[nodiscard]] std::string name(int index) const override {
    return fmt::format("{}, image {}", file_, index);
  }

  [[nodiscard]] std::optional<SourceImage> image(int index) override {
    while (index_ < index) {
      if (!advance()) return std::nullopt;
    }
    SourceImage image;
    image.index = index_;
    image.timestamp = capture_->time();
    if (!capture_->retrieve(image)) throw fileError(name(index_), "cannot be decoded");
    image.warning = warning_;
    told_ = true;
    return image;
  }

  int seek(double seconds) override {
    while (!ended_ && capture_->time() - begin_ < seconds) {
      if (!advance()) return index_ + 1;
    }
    return index_;
  }

 private:
  bool advance() {
    const double before = capture_->time();
    if (ended_ || !capture_->grab()) {
      if (!std::exchange(ended_, true)) refuseCutFile();
      return false;
    }
    ++index_;
    if (std::exchange(told_, false)) warning_.clear();
    const double step = (capture_->time() - before) * capture_->rate();
    if (!uneven_ && (step > kUnevenStep || step < 1 / kUnevenStep)) {
      uneven_ = true;
      warn(
          fmt::format("{:.3g} s after the one before, at a nominal rate of {:.3g} images a second; "
                      "the rate varies, the times of the images are used",
                      capture_->time() - before,
                      capture_->rate()));
    }
    takeDoubts();
    return true;
  }

  void takeDoubts() {
    const std::string doubts = capture_->takeDoubts();
    if (!doubts.empty()) warn(doubts);
  }
  void warn(const std::string& what) {
    warning_ += fmt::format("{}{}: {}", warning_.empty() ? "" : "; ", name(index_), what);
  }

  void refuseCutFile() const {
    const double missing = capture_->missingShare();
    const int count = index_ + 1;
    const double expected = count / (1 - std::min(missing, 0.999));
    if (missing < kMissingShare || expected < count + kFewImages) return;
    throw fileError(file_,
                    "ends after {} of about {:.0f} images, {:.0f} % before the end that it "
                    "announces; is the file complete?",
                    count,
                    expected,
                    100 * missing);
  }

  std::string file_;
  std::unique_ptr<Capture> capture_;
  double begin_ = 0;
  int index_ = 0;
  bool ended_ = false;
  bool uneven_ = false;
  std::string warning_;  // of the images since the last one that was asked for
  bool told_ = false;    // with that one
};

}  // namespace

bool isCameraAddress(const std::string& path) {
  return path.rfind("/dev/video", 0) == 0 || path.find("://") != std::string::npos;
}

std::unique_ptr<ImageSource> openVideo(const std::filesystem::path& file) {
  return std::make_unique<VideoFile>(file);
}

namespace {

using Clock = std::chrono::steady_clock;

// The same as in codecs_module.cpp, where FFmpeg gives up by itself; a little later does this
// reader, for what FFmpeg cannot end.
constexpr std::chrono::milliseconds kPatience(5000);
constexpr std::chrono::milliseconds kOpeningPatience(10000);
constexpr std::chrono::milliseconds kMargin(500);
constexpr std::chrono::milliseconds kFarewell(500);  // for an image that is being read at the end

double secondsSince1970() {
  return std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
}

/// Takes every image of a camera. One thread runs it, another asks.
class Taker {
 public:
  explicit Taker(std::string address)
      : address_(std::move(address)), is_file_(std::filesystem::is_regular_file(address_)) {}

  /// Until the camera ends or stop() is called.
  void run() {
    std::exception_ptr failure;
    try {
      takeAll();
    } catch (...) {
      failure = std::current_exception();
    }
    const std::lock_guard<std::mutex> lock(mutex_);
    failure_ = failure;
    ended_ = true;
    changed_.notify_all();
  }

  /// @throws IoError where the camera cannot be opened
  void waitUntilOpen() {
    std::unique_lock<std::mutex> lock(mutex_);
    const bool answered =
        changed_.wait_for(lock, kOpeningPatience + kMargin, [this] { return opened_ || ended_; });
    if (failure_) std::rethrow_exception(failure_);
    if (!answered) throw fileError(address_, "cannot be opened within ten seconds");
  }

  /// Waits for an image that was not given yet.
  std::optional<SourceImage> next() {
    std::unique_lock<std::mutex> lock(mutex_);
    const bool came = changed_.wait_for(
        lock, kPatience + kMargin, [this] { return !waiting_.empty() || ended_; });
    if (!waiting_.empty()) {
      SourceImage image = std::move(waiting_.front());
      waiting_.pop_front();
      image.late = !waiting_.empty();
      return image;
    }
    if (failure_) std::rethrow_exception(failure_);
    if (came && is_file_) return std::nullopt;
    if (Clock::now() - last_sign_ >= kPatience) {
      throw fileError(address_, "no image for five seconds");
    }
    throw fileError(address_, "the camera went away after {} images", count_);
  }

  /// @return whether run() is at its end; where it is not, it ends after the read that it is in
  bool stop() {
    std::unique_lock<std::mutex> lock(mutex_);
    stopped_ = true;
    changed_.notify_all();
    return changed_.wait_for(lock, kFarewell, [this] { return ended_; });
  }

  [[nodiscard]] int dropped() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return dropped_;
  }

 private:
  void takeAll() {
    const std::unique_ptr<Capture> capture = openCapture(address_);
    const Clock::time_point begin = Clock::now();
    const double since_1970 = secondsSince1970();
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      opened_ = true;
      last_sign_ = begin;
      changed_.notify_all();
    }
    while (grabInTime(*capture)) {
      SourceImage image;
      const auto elapsed = std::chrono::duration<double>(Clock::now() - begin);
      image.timestamp = is_file_ ? capture->time() : since_1970 + elapsed.count();
      if (!capture->retrieve(image)) {
        if (!is_file_) return;
        throw fileError(address_, "image {} cannot be decoded", count_);
      }
      image.pixels = image.pixels.clone();  // the capture writes over its own
      if (is_file_) waitFor(begin, capture->time());
      if (!keep(std::move(image))) return;
    }
  }

  /// What FFmpeg has of an image when it gives up is none.
  static bool grabInTime(Capture& capture) {
    const Clock::time_point begin = Clock::now();
    return capture.grab() && Clock::now() - begin < kPatience;
  }

  /// The image of a file is there when its time has come.
  void waitFor(Clock::time_point begin, double time) {
    std::unique_lock<std::mutex> lock(mutex_);
    if (count_ == 0) first_time_ = time;
    const auto due = begin + std::chrono::duration_cast<Clock::duration>(
                                 std::chrono::duration<double>(time - first_time_));
    changed_.wait_until(lock, due, [this] { return stopped_; });
  }

  /// @return whether more are wanted
  bool keep(SourceImage&& image) {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (stopped_) return false;
    last_sign_ = Clock::now();
    image.index = count_++;
    if (waiting_.size() == kCameraBuffers) {
      waiting_.pop_front();
      ++dropped_;
    }
    waiting_.push_back(std::move(image));
    changed_.notify_all();
    return true;
  }

  const std::string address_;
  const bool is_file_;
  double first_time_ = 0;  // of the thread that runs [s]

  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<SourceImage> waiting_;  // oldest first
  std::exception_ptr failure_;
  Clock::time_point last_sign_;
  int count_ = 0;
  int dropped_ = 0;
  bool opened_ = false;
  bool ended_ = false;
  bool stopped_ = false;
};

/// Runs a taker. Where a read never returns, as that of a pipe which somebody keeps open, the
/// thread is left to itself with what it uses.
class CameraStream : public ImageSource {
 public:
  explicit CameraStream(const std::string& address)
      : address_(address),
        taker_(std::make_shared<Taker>(address)),
        thread_([taker = taker_] { taker->run(); }) {
    try {
      taker_->waitUntilOpen();
    } catch (...) {
      end();
      throw;
    }
  }
  ~CameraStream() override { end(); }
  CameraStream(const CameraStream&) = delete;
  CameraStream& operator=(const CameraStream&) = delete;

  [[nodiscard]] int size() const override { return 0; }
  [[nodiscard]] std::string name(int index) const override {
    return fmt::format("{}, image {}", address_, index);
  }
  [[nodiscard]] std::optional<SourceImage> image(int /*index*/) override { return taker_->next(); }
  [[nodiscard]] int dropped() const override { return taker_->dropped(); }

 private:
  void end() {
    if (taker_->stop()) {
      thread_.join();
    } else {
      thread_.detach();
    }
  }

  std::string address_;
  std::shared_ptr<Taker> taker_;
  std::thread thread_;
};

}  // namespace

std::unique_ptr<ImageSource> openCamera(const std::string& address) {
  return std::make_unique<CameraStream>(address);
}

}  // namespace dsorb
