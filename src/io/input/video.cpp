// SPDX-License-Identifier: BSD-3-Clause
#include "io/input/video.h"

#include "dsorb/error.h"

#include "io/input/codecs.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <fstream>
#include <utility>

namespace dsorb {
namespace {

constexpr double kMissingShare = 0.1;  // of the announced length that may be missing
constexpr int kFewImages = 2;
constexpr double kUnevenStep = 1.5;  // times the usual one

/// Whether a file of MP4's family lacks the box that says where its images are: recorders write it
/// at the end. Boxes are their length, their name and their content.
bool lacksIndex(const std::string& file) {
  std::ifstream stream(file, std::ios::binary);
  std::array<unsigned char, 16> head{};
  std::uint64_t at = 0;
  const auto big = [&](std::size_t from, std::size_t to) {
    std::uint64_t value = 0;
    for (std::size_t i = from; i < to; ++i) value = value << 8U | head.at(i);
    return value;
  };
  while (stream.seekg(static_cast<std::streamoff>(at)) &&
         stream.read(reinterpret_cast<char*>(head.data()), head.size())) {
    const std::string name(head.begin() + 4, head.begin() + 8);
    if (at == 0 && name != "ftyp") return false;
    if (name == "moov") return false;
    const std::uint64_t length = big(0, 4) == 1 ? big(8, 16) : big(0, 4);
    if (length < 8) break;
    at += length;
  }
  return at > 0;
}

std::unique_ptr<Capture> openVideoFile(const std::string& file) {
  try {
    return openCapture(file);
  } catch (const IoError&) {
    if (!lacksIndex(file)) throw;
    throw IoError(
        fmt::format("{}: its index (moov) is missing: the recording was not finished or "
                    "the file is cut off; a tool like untrunc makes a new one by another "
                    "recording of the camera",
                    file));
  }
}

class VideoFile : public VideoSource {
 public:
  explicit VideoFile(const std::filesystem::path& file)
      : file_(file.string()), capture_(openVideoFile(file_)) {
    if (!capture_->grab()) {
      throw IoError(fmt::format("{}: holds no image that can be decoded", file_));
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
    if (!capture_->retrieve(image.pixels)) {
      throw IoError(fmt::format("{}: cannot be decoded", name(index_)));
    }
    image.warning = warning_;
    told_ = true;
    image.turn = capture_->turn();
    image.pixel_aspect = capture_->pixelAspect();
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
    throw IoError(
        fmt::format("{}: ends after {} of about {:.0f} images, {:.0f} % before the end that "
                    "it announces; is the file complete?",
                    file_,
                    count,
                    expected,
                    100 * missing));
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

std::unique_ptr<VideoSource> openVideo(const std::filesystem::path& file) {
  return std::make_unique<VideoFile>(file);
}

}  // namespace dsorb
