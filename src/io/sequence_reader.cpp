// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/io/sequence_reader.h"

#include "dsorb/error.h"

#include "camera/calibration_check.h"
#include "camera/photometric_correction.h"
#include "camera/undistorter.h"
#include "io/bit_depth.h"
#include "io/calibration_reader.h"
#include "io/dataset.h"
#include "io/image_decoder.h"
#include "io/prefetch_queue.h"

#include <fmt/format.h>
#include <opencv2/core.hpp>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <new>
#include <vector>

namespace dsorb {
namespace {

constexpr std::size_t kDepthSamples =
    4;  // images beside the first that show how many bits are used

double millisecondsSince(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start)
      .count();
}

std::string orDefault(const std::string& given, const std::filesystem::path& found) {
  return given.empty() ? found.string() : given;
}

/// Positions in the order they are fed.
std::vector<int> playlist(const SequenceOptions& options, int size) {
  if (options.start < 0 || options.start >= size) {
    throw ConfigError(
        fmt::format("start: {} lies outside the sequence of {} images; expected 0 to {}",
                    options.start,
                    size,
                    size - 1));
  }
  const int end = options.end < 0 ? size : std::min(options.end, size);
  if (end <= options.start) {
    throw ConfigError(fmt::format("end: {} is not above start: {}", options.end, options.start));
  }
  std::vector<int> indices;
  for (int i = options.start; i < end; ++i) indices.push_back(i);
  if (options.reverse) std::reverse(indices.begin(), indices.end());
  return indices;
}

/// Decides where nothing is asked for, and checks that what is asked for is there.
BrightnessModel brightnessModel(const SequenceOptions& options,
                                const std::string& response,
                                const std::string& vignette) {
  const std::optional<BrightnessModel> wanted = options.brightness;
  if (wanted && *wanted != BrightnessModel::kCalibrated) return *wanted;
  if (!response.empty() && !vignette.empty()) return BrightnessModel::kCalibrated;
  const bool asked = wanted || !options.response_file.empty() || !options.vignette_file.empty();
  if (!asked) return BrightnessModel::kUncalibrated;
  throw ConfigError(
      fmt::format("photometric calibration needs a response and a vignette, but there is no {}; "
                  "give it, or choose the mode uncalibrated or perfect",
                  response.empty() ? "response (pcalib.txt)" : "vignette (vignette.png)"));
}

}  // namespace

/// The whole way from file to frame. After construction only prepare() changes the scratch images,
/// and only one thread calls it.
class SequenceReader::Impl {
 public:
  explicit Impl(const SequenceOptions& options)
      : layout_(findDataset(options.path, options.format)), dataset_(openDataset(layout_)) {
    indices_ = playlist(options, dataset_.images->size());
    calibrate(options);
    queue_ = std::make_unique<PrefetchQueue<SequenceFrame>>(
        indices_.size(), options.prefetch, [this](std::size_t position) {
          return prepare(indices_[position]);
        });
  }

  [[nodiscard]] const PinholeCamera& camera() const { return undistorter_->camera(); }
  [[nodiscard]] const Dataset& dataset() const { return dataset_; }
  [[nodiscard]] int selected() const { return static_cast<int>(indices_.size()); }
  [[nodiscard]] SequenceFormat format() const { return layout_.format; }
  [[nodiscard]] BrightnessModel brightness() const { return brightness_; }
  [[nodiscard]] const std::vector<std::string>& warnings() const { return dataset_.warnings; }
  [[nodiscard]] int index(int position) const {
    return indices_.at(static_cast<std::size_t>(position));
  }
  void skip(int images) { queue_->skip(static_cast<std::size_t>(std::max(images, 0))); }
  std::optional<SequenceFrame> next() { return queue_->next(); }

 private:
  void calibrate(const SequenceOptions& options);
  void rectifyWith(const Calibration& calibration, const std::string& file);
  void calibratePhotometry(const SequenceOptions& options, const Lens& lens);
  [[nodiscard]] cv::Mat decode(int index);
  [[nodiscard]] SequenceFrame prepare(int index);
  void chooseBits(const cv::Mat& image, std::vector<std::string>& warnings);
  [[nodiscard]] std::uint16_t largestValue(const cv::Mat& image);
  void rectify(const cv::Mat& image);

  DatasetLayout layout_;
  Dataset dataset_;
  std::vector<int> indices_;
  BrightnessModel brightness_ = BrightnessModel::kUncalibrated;
  std::optional<Undistorter> undistorter_;
  std::optional<PhotometricCorrection> correction_;
  std::shared_ptr<const ResponseSlope> response_slope_;
  int bits_ = 0;                  // of 16-bit images; 0: not known before the first of them
  bool exceeded_ = false;         // by the values of one
  std::vector<float> corrected_;  // scratch, input size
  std::vector<float> rectified_;  // scratch, output size
  std::unique_ptr<PrefetchQueue<SequenceFrame>> queue_;  // last: its thread stops first
};

void SequenceReader::Impl::calibrate(const SequenceOptions& options) {
  const std::string file = orDefault(options.calibration_file, layout_.calibration);
  if (file.empty()) {
    throw IoError(fmt::format("{}: no calibration lies beside the images; give one with --calib",
                              layout_.images.string()));
  }
  Calibration calibration = readCalibration(file, layout_.kitti_camera);
  Lens& lens = calibration.lens;
  if (lens.width == 0) {
    const cv::Mat first = decode(indices_.front());
    lens.width = first.cols;
    lens.height = first.rows;
  }
  rectifyWith(calibration, file);
  calibratePhotometry(options, lens);
  if (options.bits != 0) {
    bits_ = options.bits;
    correction_->setBits(bits_);
  }
  const PinholeCamera& camera = undistorter_->camera();
  corrected_.resize(static_cast<std::size_t>(lens.width) * static_cast<std::size_t>(lens.height));
  rectified_.resize(static_cast<std::size_t>(camera.width) *
                    static_cast<std::size_t>(camera.height));
}

/// @throws IoError naming the file that the calibration comes from
void SequenceReader::Impl::rectifyWith(const Calibration& calibration, const std::string& file) {
  try {
    refuseImpossibleLens(calibration.lens);
    undistorter_.emplace(calibration.lens, calibration.rectification);
  } catch (const std::invalid_argument& error) {
    throw IoError(fmt::format("{}: {}", file, error.what()));
  } catch (const std::bad_alloc&) {
    throw IoError(fmt::format("{}: no memory for images of this size", file));
  }
  for (const std::string& doubt :
       doubtsAbout(calibration.lens, calibration.rectification.mode, undistorter_->camera())) {
    dataset_.warnings.push_back(fmt::format("{}: {}", file, doubt));
  }
}

void SequenceReader::Impl::calibratePhotometry(const SequenceOptions& options, const Lens& lens) {
  const std::string response = orDefault(options.response_file, layout_.response);
  const std::string vignette = orDefault(options.vignette_file, layout_.vignette);
  brightness_ = brightnessModel(options, response, vignette);
  if (brightness_ != BrightnessModel::kCalibrated) {
    correction_.emplace(lens.width, lens.height);
    // To an unknown response a ratio of exposures is a guess, which free brightness may correct.
    if (brightness_ == BrightnessModel::kPerfect) dataset_.exposures.clear();
    return;
  }
  PhotometricCalibration photometric;
  photometric.response = readResponse(response);
  readVignette(vignette, photometric);
  if (photometric.vignette_width != lens.width || photometric.vignette_height != lens.height) {
    throw IoError(fmt::format("{}: {}x{} px; expected the size of the images, {}x{}",
                              vignette,
                              photometric.vignette_width,
                              photometric.vignette_height,
                              lens.width,
                              lens.height));
  }
  correction_.emplace(photometric, lens.width, lens.height);
  response_slope_ = std::make_shared<const ResponseSlope>(correction_->responseSlope());
}

cv::Mat SequenceReader::Impl::decode(int index) {
  const std::string name = dataset_.images->name(index);
  try {
    return decodeGrey(dataset_.images->read(index), name);
  } catch (const std::bad_alloc&) {
    throw IoError(fmt::format("{}: no memory for this image", name));
  }
}

/// Over an image and some others of the sequence. Those that cannot be read complain in their turn.
std::uint16_t SequenceReader::Impl::largestValue(const cv::Mat& image) {
  double largest = 0;
  cv::minMaxLoc(image, nullptr, &largest);
  for (std::size_t i = 1; i <= kDepthSamples; ++i) {
    try {
      double value = 0;
      const cv::Mat other = decode(indices_[(indices_.size() - 1) * i / kDepthSamples]);
      cv::minMaxLoc(other, nullptr, &value);
      if (other.depth() == CV_16U) largest = std::max(largest, value);
    } catch (const IoError&) {
      continue;
    }
  }
  return static_cast<std::uint16_t>(largest);
}

/// With the first 16-bit image the bits are chosen; later ones must keep to them.
void SequenceReader::Impl::chooseBits(const cv::Mat& image, std::vector<std::string>& warnings) {
  if (bits_ == 0) {
    const BitDepth depth = recogniseBitDepth(largestValue(image));
    bits_ = depth.bits;
    correction_->setBits(bits_);
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

void SequenceReader::Impl::rectify(const cv::Mat& image) {
  if (image.depth() == CV_16U) {
    correction_->apply(image.ptr<std::uint16_t>(), image.step, corrected_.data());
  } else {
    correction_->apply(image.ptr<std::uint8_t>(), image.step, corrected_.data());
  }
  undistorter_->apply(corrected_.data(), rectified_.data());
}

SequenceFrame SequenceReader::Impl::prepare(int index) {
  SequenceFrame result;
  result.index = index;
  result.image_file = dataset_.images->name(index);
  auto start = std::chrono::steady_clock::now();
  const cv::Mat image = decode(index);
  if (image.cols != undistorter_->inputWidth() || image.rows != undistorter_->inputHeight()) {
    throw IoError(fmt::format("{}: {}x{} px; expected {}x{} as calibrated",
                              result.image_file,
                              image.cols,
                              image.rows,
                              undistorter_->inputWidth(),
                              undistorter_->inputHeight()));
  }
  if (image.depth() == CV_16U) chooseBits(image, result.warnings);
  rectify(image);
  result.read_milliseconds = millisecondsSince(start);

  start = std::chrono::steady_clock::now();
  FrameInfo info;
  info.id = FrameId{index};
  info.timestamp = dataset_.timestamps[static_cast<std::size_t>(index)];
  if (!dataset_.exposures.empty()) {
    info.exposure = dataset_.exposures[static_cast<std::size_t>(index)];
  }
  info.response_slope = response_slope_;
  result.frame = Frame::create(
      ImageView(rectified_.data(), undistorter_->camera().width, undistorter_->camera().height),
      info);
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
void SequenceReader::skip(int images) {
  impl_->skip(images);
}
std::optional<SequenceFrame> SequenceReader::next() {
  return impl_->next();
}

}  // namespace dsorb
