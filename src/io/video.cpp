// SPDX-License-Identifier: BSD-3-Clause
#include "io/video.h"

#include "dsorb/error.h"

#include "io/codecs.h"
#include "io/image_decoder.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <string_view>
#include <utility>

namespace dsorb {
namespace {

constexpr std::array<std::string_view, 8> kVideoSuffixes = {
    ".mp4", ".mov", ".avi", ".mkv", ".webm", ".m4v", ".mpg", ".mpeg"};
constexpr std::array<std::string_view, 8> kSoundSuffixes = {
    ".wav", ".mp3", ".m4a", ".aac", ".flac", ".ogg", ".opus", ".wma"};
constexpr double kLeastShare =
    0.9;  // of the announced images; containers may guess from the length
constexpr int kFewImages = 2;
constexpr double kUnevenStep = 1.5;  // times the usual one

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
    image.warning = warning_;
    told_ = true;
    image.turn = capture_->turn();
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
    if (std::exchange(told_, false)) warning_.clear();
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
  std::string warning_;  // of the images since the last one that was asked for
  bool told_ = false;    // with that one
};

template <std::size_t kCount>
bool hasSuffixAmong(const std::filesystem::path& file,
                    const std::array<std::string_view, kCount>& suffixes) {
  return std::find(suffixes.begin(), suffixes.end(), lowerSuffix(file)) != suffixes.end();
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

}  // namespace dsorb
