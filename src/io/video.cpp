// SPDX-License-Identifier: BSD-3-Clause
#include "io/video.h"

#include "dsorb/error.h"

#include "io/codecs.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <chrono>
#include <condition_variable>
#include <mutex>
#include <string_view>
#include <thread>
#include <utility>

namespace dsorb {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::array<std::string_view, 8> kVideoSuffixes = {
    ".mp4", ".mov", ".avi", ".mkv", ".webm", ".m4v", ".mpg", ".mpeg"};
constexpr std::array<std::string_view, 8> kSoundSuffixes = {
    ".wav", ".mp3", ".m4a", ".aac", ".flac", ".ogg", ".opus", ".wma"};
constexpr double kLeastShare =
    0.9;  // of the announced images; containers may guess from the length
constexpr int kFewImages = 2;
constexpr double kUnevenStep = 1.5;  // times the usual one
constexpr std::chrono::seconds kPatience(5);

class VideoFile : public VideoSource {
 public:
  explicit VideoFile(const std::filesystem::path& file)
      : file_(file.string()), capture_(openCapture(file_)) {
    if (!capture_->grab()) {
      throw IoError(fmt::format("{}: holds no image that can be decoded", file_));
    }
    begin_ = capture_->time();
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
    if (!capture_->retrieve(image.pixels)) {
      throw IoError(fmt::format("{}: cannot be decoded", name(index_)));
    }
    image.warning = std::exchange(warning_, {});
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
      ended_ = true;
      const int count = index_ + 1;
      if (count < kLeastShare * capture_->announced() - kFewImages) {
        throw IoError(fmt::format("{}: ends after {} of {} images; is the file complete?",
                                  file_,
                                  count,
                                  capture_->announced()));
      }
      return false;
    }
    ++index_;
    const double step = (capture_->time() - before) * capture_->rate();
    if (!uneven_ && (step > kUnevenStep || step < 1 / kUnevenStep)) {
      uneven_ = true;
      warning_ = fmt::format(
          "{}: {:.3g} s after the one before, at a nominal rate of {:.3g} images a second; the "
          "rate "
          "varies, the times of the images are used",
          name(index_),
          capture_->time() - before,
          capture_->rate());
    }
    return true;
  }

  std::string file_;
  std::unique_ptr<Capture> capture_;
  double begin_ = 0;
  int index_ = 0;
  bool ended_ = false;
  bool uneven_ = false;
  std::string warning_;
};

double secondsSince1970() {
  return std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
}

class CameraStream : public ImageSource {
 public:
  explicit CameraStream(const std::string& address)
      : address_(address),
        is_file_(std::filesystem::is_regular_file(address)),
        capture_(openCapture(address)) {
    taker_ = std::thread([this] { take(); });
  }
  ~CameraStream() override {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      stopped_ = true;
    }
    changed_.notify_all();
    taker_.join();
  }
  CameraStream(const CameraStream&) = delete;
  CameraStream& operator=(const CameraStream&) = delete;

  [[nodiscard]] int size() const override { return 0; }
  [[nodiscard]] std::string name(int index) const override {
    return fmt::format("{}, image {}", address_, index);
  }
  [[nodiscard]] std::optional<SourceImage> image(int index) override {
    if (index == asked_ && given_) return given_;
    asked_ = index;
    std::unique_lock<std::mutex> lock(mutex_);
    const bool came = changed_.wait_for(lock, kPatience, [this] { return newest_ || ended_; });
    if (!came) throw IoError(fmt::format("{}: no image for five seconds", address_));
    given_ = std::exchange(newest_, std::nullopt);
    if (given_ || is_file_) return given_;
    throw IoError(fmt::format("{}: the camera went away after {} images", address_, count_));
  }
  [[nodiscard]] int dropped() const override {
    const std::lock_guard<std::mutex> lock(mutex_);
    return dropped_;
  }

 private:
  void take() {
    const double since_1970 = secondsSince1970();
    const Clock::time_point begin = Clock::now();
    for (;;) {
      const bool grabbed = capture_->grab();
      const auto elapsed = std::chrono::duration<double>(Clock::now() - begin);
      SourceImage image;
      image.timestamp = is_file_ ? capture_->time() : since_1970 + elapsed.count();
      const bool good = grabbed && capture_->retrieve(image.pixels);
      if (good) image.pixels = image.pixels.clone();  // the capture writes over its own
      std::unique_lock<std::mutex> lock(mutex_);
      if (good && is_file_) waitFor(begin, capture_->time(), lock);
      if (stopped_) return;
      ended_ = !good;
      if (good) {
        image.index = count_++;
        if (newest_) ++dropped_;
        newest_ = std::move(image);
      }
      changed_.notify_all();
      if (ended_) return;
    }
  }

  /// The image of a file is there when its time has come.
  void waitFor(Clock::time_point begin, double time, std::unique_lock<std::mutex>& lock) {
    if (count_ == 0) first_time_ = time;
    const auto due = begin + std::chrono::duration_cast<Clock::duration>(
                                 std::chrono::duration<double>(time - first_time_));
    changed_.wait_until(lock, due, [this] { return stopped_; });
  }

  std::string address_;
  bool is_file_;
  std::unique_ptr<Capture> capture_;  // of the taker
  double first_time_ = 0;             // of the taker [s]
  int asked_ = -1;                    // of the caller
  std::optional<SourceImage> given_;  // of the caller

  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::optional<SourceImage> newest_;
  int count_ = 0;
  int dropped_ = 0;
  bool ended_ = false;
  bool stopped_ = false;
  std::thread taker_;
};

template <std::size_t kCount>
bool hasSuffixAmong(const std::filesystem::path& file,
                    const std::array<std::string_view, kCount>& suffixes) {
  std::string suffix = file.extension().string();
  std::transform(suffix.begin(), suffix.end(), suffix.begin(), [](unsigned char c) {
    return static_cast<char>(std::tolower(c));
  });
  return std::find(suffixes.begin(), suffixes.end(), suffix) != suffixes.end();
}

}  // namespace

bool hasVideoSuffix(const std::filesystem::path& file) {
  return hasSuffixAmong(file, kVideoSuffixes);
}

bool hasSoundSuffix(const std::filesystem::path& file) {
  return hasSuffixAmong(file, kSoundSuffixes);
}

bool isCameraAddress(const std::string& path) {
  return path.rfind("/dev/video", 0) == 0 || path.find("://") != std::string::npos;
}

std::unique_ptr<VideoSource> openVideo(const std::filesystem::path& file) {
  return std::make_unique<VideoFile>(file);
}

std::unique_ptr<ImageSource> openCamera(const std::string& address) {
  return std::make_unique<CameraStream>(address);
}

}  // namespace dsorb
