// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/io/sequence_reader.h"

#include "dsorb/camera/rectifier.h"
#include "dsorb/error.h"
#include "dsorb/image/frame_priors.h"

#include "io/input/dataset.h"
#include "io/input/gyroscope.h"
#include "io/input/image_decoder.h"
#include "io/input/pixel_patterns.h"
#include "io/input/playlist.h"
#include "io/input/sequence_calibration.h"

#include <fmt/format.h>
#include <opencv2/core.hpp>
#include <opencv2/core/mat.hpp>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <new>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace dsorb {

namespace fs = std::filesystem;

namespace {

/// An image beside the sequence.
/// @param what it is; `of` which images it has to have the size
/// @throws IoError where it is unreadable or of another depth or size
cv::Mat readBeside(
    const fs::path& file, int depth, cv::Size size, const char* what, const char* of) {
  cv::Mat image = decodeGrey(readFile(file), file.string());
  if (image.depth() != depth) {
    throw IoError(
        fmt::format("{}: {} of {} bits is expected", file.string(), what, depth == CV_8U ? 8 : 16));
  }
  if (image.size() == size) return image;
  throw IoError(fmt::format("{}: {}x{} px; expected the size of the {}, {}x{}",
                            file.string(),
                            image.cols,
                            image.rows,
                            of,
                            size.width,
                            size.height));
}

}  // namespace

/// Masks of a sequence: one for all images, or one for each.
class ImageMasks {
 public:
  ImageMasks() = default;
  /// @param given file or folder the user named; empty: none
  /// @param found folder beside the images; empty: none
  /// @throws IoError where what is given is missing, or the one mask is none of this size
  ImageMasks(const std::string& given, const fs::path& found, cv::Size size)
      : folder_(found), size_(size) {
    if (given.empty()) return;
    if (!fs::exists(given)) {
      throw IoError(fmt::format("{}: no such mask or folder of masks", given));
    }
    if (fs::is_directory(given)) {
      folder_ = given;
    } else {
      common_ = read(given);
    }
  }

  /// The mask of all images; empty: none.
  [[nodiscard]] const cv::Mat& common() const { return common_; }
  /// The mask of one image alone: under the image's name, or with .png after or instead of its
  /// suffix. Empty where images have none of their own.
  /// @throws IoError where it is missing, unreadable or of another size
  [[nodiscard]] cv::Mat of(const std::string& image) const {
    if (folder_.empty()) return {};
    const fs::path name = fs::path(image).filename();
    const fs::path png = fs::path(name).replace_extension(".png");
    for (const fs::path& candidate : {name, png, fs::path(name.string() + ".png")}) {
      if (fs::is_regular_file(folder_ / candidate)) return read(folder_ / candidate);
    }
    throw IoError(fmt::format("{}: no mask for {}; expected one for each image, here {} or {}",
                              folder_.string(),
                              image,
                              name.string(),
                              png.string()));
  }

 private:
  [[nodiscard]] cv::Mat read(const fs::path& file) const {
    return readBeside(file, CV_8U, size_, "a mask", "images");
  }

  fs::path folder_;
  cv::Mat common_;
  cv::Size size_;
};

namespace {

/// Priors of an image from its depth image, the file of its name with the suffix .png: 16 bits,
/// millimetres along the optical axis, 0 where there is none.
/// @param relative_sigma standard deviation of a depth over it [-]
/// @param size           of the rectified images, which it belongs to
/// @throws IoError where the file is missing, unreadable or of another size
std::shared_ptr<const FramePriors> depthOf(const std::string& image,
                                           const fs::path& folder,
                                           double relative_sigma,
                                           cv::Size size) {
  constexpr float kMetres = 1e-3F;  // of a value
  const fs::path file = folder / fs::path(image).filename().replace_extension(".png");
  if (!fs::is_regular_file(file)) {
    throw IoError(fmt::format("{}: no depth image for {}", file.string(), image));
  }
  cv::Mat metres;
  readBeside(file, CV_16U, size, "a depth image", "rectified images")
      .convertTo(metres, CV_32F, kMetres);
  auto priors = std::make_shared<FramePriors>();
  priors->depth = denseDepth({metres.ptr<float>(), metres.cols, metres.rows}, 0, relative_sigma);
  return priors;
}

constexpr int kDepthSamples = 4;  // images beside the first that show how many bits are used

double millisecondsSince(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start)
      .count();
}

/// Images that may be prepared ahead without taking much memory.
int imagesAhead(const PinholeCamera& camera) {
  constexpr double kBytesAhead = 100e6;
  constexpr double kBytesPerPixel = 16;  // of a pyramid
  return static_cast<int>(kBytesAhead / (kBytesPerPixel * camera.width * camera.height));
}

/// @param mask empty or of 8 bits
ImageView viewOf(const cv::Mat& mask) {
  return mask.empty() ? ImageView() : ImageView(mask.data, mask.cols, mask.rows, mask.step);
}

}  // namespace

/// The whole way from file to frame. After construction only prepare() uses source and rectifier,
/// and only one thread calls it.
class SequenceReader::Impl {
 public:
  explicit Impl(const SequenceOptions& options)
      : layout_(layoutOf(options)),
        dataset_(openDataset(layout_)),
        skip_unreadable_(options.skip_unreadable && !isStream()) {
    playlist_ = select(options);
    calibrate(options);
    const int prefetch = layout_.format == SequenceFormat::kCamera
                             ? 0
                             : std::min(options.prefetch, imagesAhead(rectifier_->camera()));
    queue_ = std::make_unique<PrefetchQueue<SequenceFrame>>(
        playlist_.count, prefetch, [this](std::size_t position) {
          return prepare(playlist_.index(position));
        });
  }

  [[nodiscard]] const PinholeCamera& camera() const { return rectifier_->camera(); }
  [[nodiscard]] const Lens& lens() const { return lens_; }
  [[nodiscard]] const Dataset& dataset() const { return dataset_; }
  [[nodiscard]] int selected() const { return static_cast<int>(playlist_.expected); }
  [[nodiscard]] int dropped() const { return dataset_.images->dropped(); }
  [[nodiscard]] SequenceFormat format() const { return layout_.format; }
  [[nodiscard]] BrightnessModel brightness() const { return brightness_; }
  [[nodiscard]] const std::vector<std::string>& warnings() const { return dataset_.warnings; }
  [[nodiscard]] int index(int position) const {
    if (position < 0 || position >= selected()) {
      throw std::out_of_range(fmt::format("position {} of {} images", position, selected()));
    }
    return playlist_.index(static_cast<std::size_t>(position));
  }
  void skip(int images) { queue_->skip(static_cast<std::size_t>(std::max(images, 0))); }
  [[nodiscard]] const std::vector<std::string>& unreadable() const { return unreadable_; }
  /// Images that cannot be read are noted and passed over.
  std::optional<SequenceFrame> next() {
    std::vector<std::string> complaints;
    while (true) {
      std::optional<SequenceFrame> frame = queue_->next();
      if (!frame) return frame;
      frame->warnings.insert(frame->warnings.begin(), complaints.begin(), complaints.end());
      if (frame->frame) return frame;
      unreadable_.push_back(frame->image_file);
      complaints = std::move(frame->warnings);
    }
  }

 private:
  static DatasetLayout layoutOf(const SequenceOptions& options) {
    DatasetLayout layout = findDataset(options.path, options.format);
    for (const std::string& file : {options.mask, options.vignette_file}) {
      if (!file.empty()) layout.others.emplace_back(file);
    }
    return layout;
  }
  [[nodiscard]] bool isStream() const {
    return layout_.format == SequenceFormat::kCamera || layout_.format == SequenceFormat::kVideo;
  }
  [[nodiscard]] Playlist select(const SequenceOptions& options) {
    if (layout_.format == SequenceFormat::kCamera) return selectLive(options);
    if (layout_.format != SequenceFormat::kVideo) {
      return selectImages(options, dataset_.images->size(), dataset_.timestamps);
    }
    return selectVideo(options, *dataset_.images, dataset_.timestamps.front(), dataset_.rate);
  }
  void calibrate(const SequenceOptions& options);
  void readCommonMask(const SequenceOptions& options);
  [[nodiscard]] FirstImage firstImage(bool needed);
  [[nodiscard]] std::optional<SourceImage> read(int index);
  [[nodiscard]] std::optional<SourceImage> readSized(int index);
  [[nodiscard]] std::optional<SequenceFrame> prepare(int index);
  [[nodiscard]] std::shared_ptr<const FramePriors> withRotation(
      std::shared_ptr<const FramePriors> priors, const FrameInfo& info);
  void demosaic(cv::Mat& image, std::vector<std::string>& warnings);
  void chooseBits(const cv::Mat& image, std::vector<std::string>& warnings);
  void leaveOutBars(const cv::Mat& image, std::vector<std::string>& warnings);
  [[nodiscard]] std::uint16_t largestValue(const cv::Mat& image);

  DatasetLayout layout_;
  Dataset dataset_;
  bool skip_unreadable_;
  Playlist playlist_;
  BrightnessModel brightness_ = BrightnessModel::kUncalibrated;
  std::optional<Rectifier> rectifier_;
  Lens lens_;
  ImageMasks masks_;
  BarFinder bars_;
  fs::path depths_;  // folder of the depth images; empty: none
  double depth_sigma_ = 0;
  std::optional<Gyroscope> gyroscope_;
  std::optional<std::pair<FrameId, double>> before_;  // the frame and its time
  std::optional<SourceImage> first_;                  // decoded for its size, until it is read
  std::optional<bool> mosaic_;                        // empty: too dark to tell, so far
  bool combed_ = false;                               // an image is interlaced
  std::vector<std::string> unreadable_;
  int bits_ = 0;           // of 16-bit images; 0: not known before the first of them
  bool exceeded_ = false;  // by the values of one
  std::unique_ptr<PrefetchQueue<SequenceFrame>> queue_;  // last: its thread stops first
};

void SequenceReader::Impl::calibrate(const SequenceOptions& options) {
  SequenceCalibration calibration =
      calibrateSequence(options, layout_, firstImage(!options.lens && isGuess(options, layout_)));
  rectifier_.emplace(std::move(calibration.rectifier));
  lens_ = calibration.lens;
  brightness_ = calibration.brightness;
  dataset_.warnings.insert(
      dataset_.warnings.end(), calibration.warnings.begin(), calibration.warnings.end());
  // To an unknown response a ratio of exposures is a guess, which free brightness may correct.
  if (brightness_ == BrightnessModel::kPerfect) dataset_.exposures.clear();
  bits_ = options.bits;
  if (bits_ != 0) rectifier_->setBits(bits_);
  dataset_.images->expect({rectifier_->inputWidth(), rectifier_->inputHeight()});
  readCommonMask(options);
  if (options.depth_sigma > 0) {
    depths_ = fs::path(options.path) / "depth";
    depth_sigma_ = options.depth_sigma;
    if (!fs::is_directory(depths_)) {
      throw IoError(fmt::format("{}: no such folder of depth images", depths_.string()));
    }
  }
  if (!options.gyroscope_file.empty()) {
    gyroscope_.emplace(options.gyroscope_file, options.R_cam_gyro);
  }
}

void SequenceReader::Impl::readCommonMask(const SequenceOptions& options) {
  masks_ = ImageMasks(
      options.mask, layout_.masks, {rectifier_->inputWidth(), rectifier_->inputHeight()});
  try {
    rectifier_->setMask(viewOf(masks_.common()));
  } catch (const std::invalid_argument& error) {
    throw IoError(fmt::format("{}: {}", options.mask, error.what()));
  }
}

/// Empty where the first image cannot be read, which it says in its turn; where the size is needed,
/// and of a stream, it is said at once.
FirstImage SequenceReader::Impl::firstImage(bool needed) {
  try {
    first_ = read(playlist_.index(0));
    return first_ ? FirstImage{first_->pixels.size(), first_->turn, first_->pixel_aspect}
                  : FirstImage{};
  } catch (const IoError&) {
    if (isStream() || needed) throw;
    return {};
  }
}

std::optional<SourceImage> SequenceReader::Impl::read(int index) {
  if (first_ && index == playlist_.index(0)) return std::exchange(first_, std::nullopt);
  try {
    return dataset_.images->image(index);
  } catch (const std::bad_alloc&) {
    throw IoError(fmt::format("{}: no memory for this image", dataset_.images->name(index)));
  }
}

/// Over an image and some others of the sequence. Those that cannot be read complain in their turn.
std::uint16_t SequenceReader::Impl::largestValue(const cv::Mat& image) {
  double largest = 0;
  cv::minMaxLoc(image, nullptr, &largest);
  for (int i = 1; i <= kDepthSamples; ++i) {
    try {
      double value = 0;
      const auto other = read(index((selected() - 1) * i / kDepthSamples));
      if (!other || other->pixels.depth() != CV_16U) continue;
      cv::minMaxLoc(other->pixels, nullptr, &value);
      largest = std::max(largest, value);
    } catch (const IoError&) {
      continue;
    }
  }
  return static_cast<std::uint16_t>(largest);
}

/// Chooses the bits with the first 16-bit image; later ones must keep to them.
void SequenceReader::Impl::chooseBits(const cv::Mat& image, std::vector<std::string>& warnings) {
  if (bits_ == 0) {
    const BitDepth depth = recogniseBitDepth(largestValue(image));
    bits_ = depth.bits;
    rectifier_->setBits(bits_);
    if (!depth.warning.empty()) warnings.push_back(depth.warning);
  }
  double largest = 0;
  if (bits_ < 16 && !exceeded_) cv::minMaxLoc(image, nullptr, &largest);
  if (largest < std::exp2(bits_)) return;
  exceeded_ = true;
  warnings.push_back(
      fmt::format("a value of {} does not fit into {} bits and counts as the largest "
                  "that does; say with --bits how many the images have",
                  largest,
                  bits_));
}

void SequenceReader::Impl::leaveOutBars(const cv::Mat& image, std::vector<std::string>& warnings) {
  const bool had_bars = bars_.bars().any();
  if (!bars_.look(image)) return;
  rectifier_->setMask(viewOf(withoutBars(bars_.bars(), image.size(), masks_.common())));
  if (!had_bars) warnings.push_back(describe(bars_.bars()));
}

/// The first image that is light enough decides for all.
void SequenceReader::Impl::demosaic(cv::Mat& image, std::vector<std::string>& warnings) {
  if (image.channels() != 1) return;
  if (!mosaic_) {
    mosaic_ = isMosaic(image);
    if (mosaic_.value_or(false)) {
      warnings.emplace_back(
          "the images are mosaics of colours (Bayer): the mean over its neighbours, with the "
          "weights 1 2 1, replaces each pixel");
    }
  }
  if (mosaic_.value_or(false)) image = greyOfMosaic(image);
}

std::optional<SourceImage> SequenceReader::Impl::readSized(int index) {
  std::optional<SourceImage> image = read(index);
  const cv::Size expected(rectifier_->inputWidth(), rectifier_->inputHeight());
  if (image && image->pixels.size() != expected) {
    throw wrongSize(dataset_.images->name(image->index), image->pixels.size(), expected);
  }
  return image;
}

std::shared_ptr<const FramePriors> SequenceReader::Impl::withRotation(
    std::shared_ptr<const FramePriors> priors, const FrameInfo& info) {
  const auto before = std::exchange(before_, std::make_pair(info.id, info.timestamp));
  if (!gyroscope_ || !before) return priors;
  const auto turn = gyroscope_->between(before->first, before->second, info.timestamp);
  if (!turn) return priors;
  auto all = priors ? std::make_shared<FramePriors>(*priors) : std::make_shared<FramePriors>();
  all->pose = turn;
  return all;
}

std::optional<SequenceFrame> SequenceReader::Impl::prepare(int index) {
  SequenceFrame result;
  auto start = std::chrono::steady_clock::now();
  std::optional<SourceImage> image;
  try {
    image = readSized(index);
  } catch (const IoError& error) {
    if (isStream()) throw;
    if (!skip_unreadable_)
      throw IoError(fmt::format("{}; --skip-unreadable passes over such images", error.what()));
    result.image_file = dataset_.images->name(index);
    result.warnings.push_back(fmt::format("{}; passed over", error.what()));
    return result;
  }
  if (!image || playlist_.isAfterEnd(image->timestamp)) return std::nullopt;
  result.index = image->index;
  result.image_file = dataset_.images->name(image->index);
  result.late = image->late;
  if (!image->warning.empty()) result.warnings.push_back(image->warning);
  demosaic(image->pixels, result.warnings);
  if (!combed_ && (combed_ = isInterlaced(image->pixels))) {
    result.warnings.push_back(fmt::format(
        "{}: interlaced, though nothing says so: every second row is of another moment; "
        "ffmpeg -i FILE -vf yadif NEW takes them apart",
        result.image_file));
  }
  leaveOutBars(image->pixels, result.warnings);
  const cv::Mat mask = masks_.of(result.image_file);
  if (image->pixels.depth() == CV_16U) chooseBits(image->pixels, result.warnings);
  std::shared_ptr<const FramePriors> priors;
  if (!depths_.empty()) {
    const cv::Size size(camera().width, camera().height);
    priors = depthOf(result.image_file, depths_, depth_sigma_, size);
  }
  const ImageView rectified = rectifier_->rectify(rawImage(image->pixels), viewOf(mask));
  result.read_milliseconds = millisecondsSince(start);

  start = std::chrono::steady_clock::now();
  FrameInfo info;
  const auto entry = static_cast<std::size_t>(image->index);
  info.id = FrameId{image->index};
  info.timestamp = image->timestamp ? *image->timestamp : dataset_.timestamps[entry];
  if (!dataset_.exposures.empty()) info.exposure = dataset_.exposures[entry];
  info.response_slope = rectifier_->responseSlope();
  info.row_times = rectifier_->rowTimes();
  info.priors = withRotation(priors, info);
  result.frame = Frame::create(rectified, info);
  result.pyramid_milliseconds = millisecondsSince(start);
  return result;
}

SequenceReader::SequenceReader(const SequenceOptions& options)
    : impl_(std::make_unique<Impl>(options)) {}
SequenceReader::~SequenceReader() = default;
SequenceReader::SequenceReader(SequenceReader&&) noexcept = default;
SequenceReader& SequenceReader::operator=(SequenceReader&&) noexcept = default;

const PinholeCamera& SequenceReader::camera() const {
  return impl_->camera();
}
const Lens& SequenceReader::lens() const {
  return impl_->lens();
}
int SequenceReader::size() const {
  return impl_->dataset().images->size();
}
int SequenceReader::selected() const {
  return impl_->selected();
}
SequenceFormat SequenceReader::format() const {
  return impl_->format();
}
BrightnessModel SequenceReader::brightness() const {
  return impl_->brightness();
}
double SequenceReader::timestamp(int index) const {
  return impl_->dataset().timestamps.at(static_cast<std::size_t>(index));
}
const std::vector<std::string>& SequenceReader::warnings() const {
  return impl_->warnings();
}
int SequenceReader::index(int position) const {
  return impl_->index(position);
}
int SequenceReader::dropped() const {
  return impl_->dropped();
}
const std::vector<std::string>& SequenceReader::unreadable() const {
  return impl_->unreadable();
}
void SequenceReader::skip(int images) {
  impl_->skip(images);
}
std::optional<SequenceFrame> SequenceReader::next() {
  return impl_->next();
}

}  // namespace dsorb
