// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/io/sequence_reader.h"

#include "dsorb/camera/rectifier.h"
#include "dsorb/error.h"
#include "dsorb/image/frame_priors.h"
#include "dsorb/io/calibration_reader.h"

#include "camera/lens_models.h"
#include "camera/photometric_correction.h"
#include "io/input/dataset.h"
#include "io/input/gyroscope.h"
#include "io/input/image_decoder.h"
#include "io/input/pixel_patterns.h"
#include "io/text_file.h"

#include <fmt/format.h>
#include <opencv2/core.hpp>
#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <future>
#include <map>
#include <memory>
#include <new>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace dsorb {

namespace fs = std::filesystem;

/// Which images of a source are read, in this order.
struct Playlist {
  std::size_t count = 0;     ///< at most; images may end before
  std::size_t expected = 0;  ///< number of images as far as known
  int first = 0;
  int step = 1;              ///< negative: backwards
  std::optional<double> to;  ///< [s]: nothing after it, where times come with the images

  [[nodiscard]] int index(std::size_t position) const {
    return first + static_cast<int>(position) * step;
  }
  [[nodiscard]] bool isAfterEnd(std::optional<double> timestamp) const {
    return to && timestamp && *timestamp > *to;
  }
};

/// Makes the frames 0 .. count - 1 in order, each while the one before is used where that is
/// wanted. The maker ends them earlier by making nothing, or by an exception.
class FrameQueue {
 public:
  using Make = std::function<std::optional<SequenceFrame>(std::size_t)>;

  FrameQueue(std::size_t count, bool is_ahead, Make make)
      : count_(count), is_ahead_(is_ahead), make_(std::move(make)) {}

  /// Leaves out the next frames; those not yet begun are never made.
  void skip(std::size_t frames) { next_ += std::min(frames, count_ - next_); }

  /// @return the next frame; empty after the last one or after an exception
  std::optional<SequenceFrame> next() {
    while (next_ < count_) {
      if (!frame_.valid()) begin();
      const std::size_t begun = begun_;
      const std::size_t wanted = std::exchange(next_, count_);  // stays there after an exception
      std::optional<SequenceFrame> frame = frame_.get();
      if (!frame) return frame;
      next_ = std::max(wanted, begun + 1);
      if (is_ahead_ && next_ < count_) begin();
      if (begun == wanted) return frame;  // not begun before a skip
    }
    return std::nullopt;
  }

 private:
  void begin() {
    begun_ = next_;
    constexpr auto kAhead =
        std::launch::async | std::launch::deferred;  // without a thread to spare
    frame_ = std::async(is_ahead_ ? kAhead : std::launch::deferred, make_, begun_);
  }

  const std::size_t count_;
  const bool is_ahead_;
  const Make make_;
  std::size_t next_ = 0;                             // to be delivered
  std::size_t begun_ = 0;                            // that `frame_` becomes
  std::future<std::optional<SequenceFrame>> frame_;  // last: its end is waited for
};

namespace {

constexpr std::size_t kEndless = std::size_t{1} << 30U;
constexpr std::size_t kMostKept = std::size_t{128} << 20U;  // of decoded images [bytes]
constexpr double kTimeTolerance = 1e-6;  // [s] "--to 1.2" means the image at 12 * 0.1 s, too

void check(const SequenceOptions& options) {
  if (options.every < 1) {
    throw ConfigError(fmt::format("every: {}; expected 1 or more", options.every));
  }
  if (!(options.from >= 0 && options.to >= 0)) {
    throw ConfigError("from, to: seconds after the first image are expected, not negative");
  }
  if (options.to > 0 && options.to < options.from) {
    throw ConfigError(fmt::format("to: {} s is before from: {} s", options.to, options.from));
  }
  if (options.end >= 0 && options.end <= options.start) {
    throw ConfigError(fmt::format("end: {} is not above start: {}", options.end, options.start));
  }
}

/// Images selected by start, end, from, to, every and reverse.
/// @param timestamps [s], one for each image
/// @throws ConfigError where nothing is selected
Playlist selectImages(const SequenceOptions& options, const std::vector<double>& timestamps) {
  const int size = static_cast<int>(timestamps.size());
  check(options);
  if (options.start < 0 || options.start >= size) {
    throw ConfigError(
        fmt::format("start: {} lies outside the sequence of {} images; expected 0 to {}",
                    options.start,
                    size,
                    size - 1));
  }
  int end = options.end < 0 ? size : std::min(options.end, size);
  const double begin = timestamps.front();
  const auto index_of = [&](auto time) { return static_cast<int>(time - timestamps.begin()); };
  const int start =
      std::max(options.start,
               index_of(std::lower_bound(
                   timestamps.begin(), timestamps.end(), begin + options.from - kTimeTolerance)));
  if (options.to > 0) {
    end = std::min(end,
                   index_of(std::upper_bound(
                       timestamps.begin(), timestamps.end(), begin + options.to + kTimeTolerance)));
  }
  if (end <= start) {
    throw ConfigError(
        fmt::format("no image is selected; the sequence takes {:g} s", timestamps.back() - begin));
  }
  Playlist playlist;
  playlist.count = 1 + static_cast<std::size_t>((end - start - 1) / options.every);
  playlist.expected = playlist.count;
  playlist.first = options.reverse ? end - 1 : start;
  playlist.step = options.reverse ? -options.every : options.every;
  return playlist;
}

/// Images of a video selected by start, end, from, to and every.
/// @throws ConfigError where nothing is selected, and on `reverse`
Playlist selectVideo(const SequenceOptions& options, ImageSource& video) {
  check(options);
  if (options.reverse) throw ConfigError("reverse: a video is read forwards only");
  Playlist playlist;
  playlist.first = options.start;
  if (options.from > 0) {
    playlist.first = std::max(playlist.first, video.seek(options.from - kTimeTolerance));
  }
  playlist.step = options.every;
  const auto positions = [&](double end) {
    return static_cast<std::size_t>(
        std::max(0.0, std::ceil((end - playlist.first) / options.every)));
  };
  playlist.count = options.end >= 0 ? positions(options.end) : kEndless;
  playlist.expected = std::min(playlist.count, positions(video.size()));
  if (options.to > 0) {
    playlist.to = video.begin() + options.to + kTimeTolerance;
    playlist.expected =
        std::min(playlist.expected, positions(std::floor(options.to * video.rate()) + 1));
  }
  if (!video.image(playlist.first)) {
    throw ConfigError(fmt::format("no image is selected; the video has about {}", video.size()));
  }
  return playlist;
}

std::string orDefault(const std::string& given, const fs::path& found) {
  return given.empty() ? found.string() : given;
}

/// Whether the lens is a guess: by a field of view, or because nothing is known of it.
bool isGuess(const SequenceOptions& options, const DatasetLayout& layout) {
  return options.horizontal_view > 0 ||
         orDefault(options.calibration_file, layout.calibration).empty();
}

/// Decides where no mode is asked for, and checks that what is asked for is there.
BrightnessModel brightnessModel(const SequenceOptions& options,
                                const std::string& response,
                                const std::string& vignette,
                                std::vector<std::string>& warnings) {
  const std::optional<BrightnessModel> wanted = options.brightness;
  if (wanted && *wanted != BrightnessModel::kCalibrated) return *wanted;
  if (!response.empty() && !vignette.empty()) return BrightnessModel::kCalibrated;
  const std::string missing =
      fmt::format("photometric calibration needs a response and a vignette, but there is no {}",
                  response.empty() ? "response (pcalib.txt)" : "vignette (vignette.png)");
  if (wanted) {
    throw ConfigError(missing + "; give it, or choose the mode uncalibrated or perfect");
  }
  for (const std::string& alone : {options.response_file, options.vignette_file}) {
    if (alone.empty()) continue;
    if (!fs::exists(alone)) throw IoError(alone + ": cannot be read");
    warnings.push_back(fmt::format("{}: not used; {}", alone, missing));
  }
  return BrightnessModel::kUncalibrated;
}

/// Lens and rectification, and where they come from.
struct Geometry {
  Calibration calibration;
  std::string source;
};

/// A lens as it is given or guessed.
Geometry readLens(const SequenceOptions& options, const SourceImage& first) {
  const bool stated = options.horizontal_view > 0;
  const cv::Size size = first.pixels.size();
  Calibration calibration;
  if (options.lens) {
    calibration.lens = *options.lens;
  } else if (!options.calibration_file.empty() || !options.camera.empty()) {
    throw ConfigError(stated ? "a calibration file or a camera of one, and a field of view are "
                               "given; expected one of them"
                             : "--camera " + options.camera + ": there is no calibration with it");
  } else if (size.empty()) {
    throw fileError(options.path, "the first image cannot be read");
  } else {
    calibration.lens = stated ? lensOfFieldOfView(options.horizontal_view, size.width, size.height)
                              : unknownLens(size.width, size.height);
    calibration.lens.fy *= first.pixel_aspect;
  }
  const bool bent = isDistorted(calibration.lens);
  calibration.rectification.mode = bent ? RectificationMode::kCrop : RectificationMode::kNone;
  return {calibration, options.lens ? "lens" : stated ? "field of view" : "unknown camera"};
}

Geometry readGeometry(const SequenceOptions& options,
                      const DatasetLayout& layout,
                      const SourceImage& first) {
  if (options.lens || isGuess(options, layout)) return readLens(options, first);
  const std::string file = orDefault(options.calibration_file, layout.calibration);
  return {
      readCalibration(file, {options.camera, layout.images, first.pixels.cols, first.pixels.rows}),
      file};
}

/// Width that images get; 0: as the calibration says.
int outputWidth(const SequenceOptions& options, const Lens& lens) {
  const bool calibrated = !options.lens && lens.focal_sigma == 0;
  const int side = std::max(lens.width, lens.height);
  if (options.width >= 0 || calibrated || side <= kMostGuessedSide) return options.width;
  return lens.width * kMostGuessedSide / side;
}

/// How far the calibration must be turned with the images, which the sensor has otherwise: not at
/// all where it has the shape of images that were turned to the side.
int turnOf(const SequenceOptions& options, const SourceImage& first, const Lens& lens) {
  const auto [width, height] = first.pixels.size();
  if (width == 0 || options.lens || lens.focal_sigma > 0) return 0;
  const bool upright = lens.width > 0 ? lens.height > lens.width : lens.cy > lens.cx;
  const bool same = upright == (height > width) && width != height;
  return first.turn % 180 != 0 && same ? 0 : first.turn;
}

PhotometricCalibration readPhotometry(const std::string& response,
                                      const std::string& vignette,
                                      const Lens& lens) {
  PhotometricCalibration photometric;
  photometric.response = readResponse(response);
  readVignette(vignette, photometric);
  if (photometric.vignette_width != lens.width || photometric.vignette_height != lens.height) {
    throw fileError(vignette,
                    "{}; expected the size of the images, {}",
                    pixelText(photometric.vignette_width, photometric.vignette_height),
                    pixelText(lens.width, lens.height));
  }
  return photometric;
}

/// An image beside the sequence.
/// @param what it is; `of` which images it has to have the size
/// @throws IoError where it is unreadable or of another depth or size
cv::Mat readBeside(
    const fs::path& file, int depth, cv::Size size, const char* what, const char* of) {
  cv::Mat image = decodeGrey(readFile(file), file.string());
  if (image.depth() != depth) {
    throw fileError(file, "{} of {} bits is expected", what, depth == CV_8U ? 8 : 16);
  }
  if (image.size() == size) return image;
  throw fileError(file,
                  "{}; expected the size of the {}, {}",
                  pixelText(image.cols, image.rows),
                  of,
                  pixelText(size.width, size.height));
}

/// The mask of one image alone: under the image's name, or with .png after or instead of its
/// suffix.
/// @throws IoError where it is missing, unreadable or of another size
cv::Mat maskOf(const std::string& image, const fs::path& folder, cv::Size size) {
  const fs::path name = fs::path(image).filename();
  const fs::path png = fs::path(name).replace_extension(".png");
  for (const fs::path& candidate : {name, png, fs::path(name.string() + ".png")}) {
    if (!fs::is_regular_file(folder / candidate)) continue;
    return readBeside(folder / candidate, CV_8U, size, "a mask", "images");
  }
  throw fileError(folder,
                  "no mask for {}; expected one for each image, here {} or {}",
                  image,
                  name.string(),
                  png.string());
}

/// Priors of an image from its depth image, the file of its name with the suffix .png: 16 bits,
/// millimetres along the optical axis, 0 where there is none.
/// @param relative_sigma standard deviation of a depth over it [-]
/// @param size           of the rectified images, which it belongs to
/// @throws IoError where the file is missing, unreadable or of another size
std::shared_ptr<FramePriors> depthOf(const std::string& image,
                                     const fs::path& folder,
                                     double relative_sigma,
                                     cv::Size size) {
  constexpr float kMetres = 1e-3F;  // of a value
  const fs::path file = folder / fs::path(image).filename().replace_extension(".png");
  if (!fs::is_regular_file(file)) throw fileError(file, "no depth image for {}", image);
  cv::Mat metres;
  readBeside(file, CV_16U, size, "a depth image", "rectified images")
      .convertTo(metres, CV_32F, kMetres);
  auto priors = std::make_shared<FramePriors>();
  priors->depth = denseDepth({metres.ptr<float>(), metres.cols, metres.rows}, 0, relative_sigma);
  return priors;
}

constexpr std::size_t kDepthSamples =
    4;  // images beside the first that show how many bits are used

double millisecondsSince(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start)
      .count();
}

/// Whether an image may be prepared ahead without taking much memory.
bool fitsInMemory(const PinholeCamera& camera) {
  constexpr double kBytesAhead = 100e6;
  constexpr double kBytesPerPixel = 16;  // of a pyramid
  return kBytesPerPixel * camera.width * camera.height <= kBytesAhead;
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
      : layout(layoutOf(options)),
        dataset(openDataset(layout)),
        skip_unreadable(options.skip_unreadable && !isStream()),
        keep_decoded(options.keep_decoded) {
    playlist = select(options);
    calibrate(options);
    const bool is_kept = options.keep_decoded && lens.focal_sigma > 0;
    if (is_kept && layout.format != SequenceFormat::kCamera) room = kMostKept;
    const bool is_ahead = options.prefetch && layout.format != SequenceFormat::kCamera &&
                          fitsInMemory(rectifier->camera());
    queue = std::make_unique<FrameQueue>(playlist.count, is_ahead, [this](std::size_t position) {
      return prepare(playlist.index(position));
    });
  }

  static DatasetLayout layoutOf(const SequenceOptions& options) {
    DatasetLayout found = findDataset(options.path, options.format);
    for (const std::string& file : {options.mask, options.vignette_file}) {
      if (!file.empty()) found.others.emplace_back(file);
    }
    return found;
  }
  [[nodiscard]] bool isStream() const {
    return layout.format == SequenceFormat::kCamera || layout.format == SequenceFormat::kVideo;
  }
  [[nodiscard]] int selected() const { return static_cast<int>(playlist.expected); }
  /// A camera gives `end` images, or images without end.
  [[nodiscard]] Playlist select(const SequenceOptions& options) {
    if (layout.format == SequenceFormat::kVideo) return selectVideo(options, *dataset.images);
    if (layout.format != SequenceFormat::kCamera) return selectImages(options, dataset.timestamps);
    if (options.start > 0 || options.from > 0 || options.to > 0 || options.every != 1 ||
        options.reverse) {
      throw ConfigError("start, from, to, every and reverse do not apply to a camera; end does");
    }
    Playlist live;
    live.count = options.end >= 0 ? static_cast<std::size_t>(options.end) : kEndless;
    return live;
  }
  [[nodiscard]] cv::Size inputSize() const {
    return {rectifier->inputWidth(), rectifier->inputHeight()};
  }
  /// Reads the calibration files that options name or that lie beside the images, and fits them to
  /// the first image's size. Where they do not say how the sensor is read, it is by its rows, which
  /// are columns of an image that was turned.
  /// @throws IoError naming the file at fault
  /// @throws ConfigError where options contradict each other or the data set
  void rectify(const SequenceOptions& options, const SourceImage& image) {
    Geometry geometry = readGeometry(options, layout, image);
    if (options.horizontal_view > 0 && image.pixels.rows > image.pixels.cols) {
      dataset.warnings.emplace_back(
          "the images are upright: --hfov is what they show from left to right, along their short "
          "side");
    }
    try {
      fit(options, image, geometry);
      rectifier.emplace(geometry.calibration);
    } catch (const std::invalid_argument& error) {
      throw fileError(geometry.source, "{}", error.what());
    } catch (const std::bad_alloc&) {
      throw fileError(geometry.source, "no memory for images of this size");
    }
    lens = geometry.calibration.lens;
    for (const std::string& doubt : rectifier->warnings()) {
      dataset.warnings.push_back(fmt::format("{}: {}", geometry.source, doubt));
    }
  }

  /// Fits a calibration to the size of the images, their brightness, how they were turned, and the
  /// width that is wanted.
  void fit(const SequenceOptions& options, const SourceImage& image, Geometry& geometry) {
    std::vector<std::string>& warnings = dataset.warnings;
    Calibration& calibration = geometry.calibration;
    const Lens read = calibration.lens;
    const int turn = turnOf(options, image, read);
    cv::Size size = image.pixels.size();
    if (turn % 180 != 0) std::swap(size.width, size.height);
    if (!size.empty()) calibration = calibrationForSize(calibration, size.width, size.height);
    if (read.width != 0 && calibration.lens.width != read.width) {
      warnings.push_back(fmt::format("{}: for images of {}, scaled to these of {}",
                                     geometry.source,
                                     pixelText(read.width, read.height),
                                     pixelText(size.width, size.height)));
    }
    const std::string response = orDefault(options.response_file, layout.response);
    const std::string vignette = orDefault(options.vignette_file, layout.vignette);
    brightness = brightnessModel(options, response, vignette, warnings);
    if (brightness == BrightnessModel::kCalibrated) {
      calibration.photometric = readPhotometry(response, vignette, calibration.lens);
    }
    if (turn != 0) {
      calibration = turned(calibration, turn);
      warnings.push_back(
          fmt::format("{}: the images were turned by {} degrees to be upright; the calibration is "
                      "taken to be the sensor's and turned with them",
                      geometry.source,
                      turn));
    }
    const int width = outputWidth(options, calibration.lens);
    if (width > 0) calibration = withOutputWidth(calibration, width);
    if (width > 0 && width != options.width) {
      warnings.push_back(
          fmt::format("images of {} are made smaller, to a width of {}; --width 0 keeps them",
                      pixelText(calibration.lens.width, calibration.lens.height),
                      width));
    }
    if (options.readout) calibration.lens.readout = *options.readout;
    const bool known = read.columns || read.readout.seconds != 0;
    if (!known && turn == 0 && !options.lens) turnReadout(image.turn, calibration.lens);
  }

  void calibrate(const SequenceOptions& options) {
    rectify(options, firstImage(!options.lens && isGuess(options, layout)));
    // To an unknown response a ratio of exposures is a guess, which free brightness may correct.
    if (brightness == BrightnessModel::kPerfect) dataset.exposures.clear();
    bits = options.bits;
    if (bits != 0) rectifier->setBits(bits);
    readMasks(options.mask);
    if (options.depth_sigma > 0) {
      depths = fs::path(options.path) / "depth";
      depth_sigma = options.depth_sigma;
      if (!fs::is_directory(depths)) throw fileError(depths, "no such folder of depth images");
    }
    if (!options.gyroscope_file.empty()) {
      gyroscope.emplace(options.gyroscope_file, options.R_cam_gyro);
    }
  }

  void readMasks(const std::string& given) {
    masks = fs::is_directory(given) ? fs::path(given) : layout.masks;
    if (!given.empty() && masks != given) {
      if (!fs::exists(given)) throw IoError(given + ": no such mask or folder of masks");
      mask = readBeside(given, CV_8U, inputSize(), "a mask", "images");
    }
    try {
      rectifier->setMask(viewOf(mask));
    } catch (const std::invalid_argument& error) {
      throw fileError(given, "{}", error.what());
    }
  }

  /// Empty where the first image cannot be read, which it says in its turn; where the size is
  /// needed, and of a stream, it is said at once.
  SourceImage firstImage(bool needed) {
    try {
      first = read(playlist.index(0));
      return first.value_or(SourceImage());
    } catch (const IoError&) {
      if (isStream() || needed) throw;
      return {};
    }
  }

  std::optional<SourceImage> read(int index) {
    if (first && index == playlist.index(0)) return std::exchange(first, std::nullopt);
    if (const auto kept = decoded.find(index); kept != decoded.end()) {
      if (keep_decoded) return kept->second;
      return std::move(decoded.extract(kept).mapped());
    }
    try {
      std::optional<SourceImage> image = dataset.images->image(index);
      if (image && room > 0) keep(*image);
      return image;
    } catch (const std::bad_alloc&) {
      throw fileError(dataset.images->name(index), "no memory for this image");
    }
  }

  /// For a reader of the same images; none where there is no room for all.
  void keep(const SourceImage& image) {
    const std::size_t size = image.pixels.total() * image.pixels.elemSize();
    room -= std::min(room, size);
    if (room == 0) return decoded.clear();
    SourceImage& kept = decoded[image.index] = image;
    kept.pixels = image.pixels.clone();
  }

  /// Goes on where another reader of the same images ended.
  void takeOver(Impl& other) {
    other.queue.reset();
    room = 0;
    if (other.decoded.empty() || other.layout.images != layout.images ||
        other.playlist.first != playlist.first || other.playlist.step != playlist.step) {
      return;
    }
    if (keep_decoded) room = other.room;
    decoded = std::move(other.decoded);
    dataset.images = std::move(other.dataset.images);
  }

  /// Over an image and some others of the sequence. Those that cannot be read complain in their
  /// turn.
  std::uint16_t largestValue(const cv::Mat& image) {
    double largest = 0;
    cv::minMaxLoc(image, nullptr, &largest);
    for (std::size_t i = 1; i <= kDepthSamples; ++i) {
      try {
        double value = 0;
        const auto other = read(playlist.index((playlist.expected - 1) * i / kDepthSamples));
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
  void chooseBits(const cv::Mat& image, std::vector<std::string>& warnings) {
    if (bits == 0) {
      const BitDepth depth = recogniseBitDepth(largestValue(image));
      bits = depth.bits;
      rectifier->setBits(bits);
      if (!depth.warning.empty()) warnings.push_back(depth.warning);
    }
    double largest = 0;
    if (bits < 16 && !exceeded) cv::minMaxLoc(image, nullptr, &largest);
    if (largest < std::exp2(bits)) return;
    exceeded = true;
    warnings.push_back(
        fmt::format("a value of {} does not fit into {} bits and counts as the largest "
                    "that does; say with --bits how many the images have",
                    largest,
                    bits));
  }

  void leaveOutBars(const cv::Mat& image, std::vector<std::string>& warnings) {
    const bool had_bars = bars.bars().any();
    if (!bars.look(image)) return;
    rectifier->setMask(viewOf(withoutBars(bars.bars(), image.size(), mask)));
    if (!had_bars) warnings.push_back(describe(bars.bars()));
  }

  /// The first image that is light enough decides for all.
  void demosaic(cv::Mat& image, std::vector<std::string>& warnings) {
    if (image.channels() != 1) return;
    if (!mosaic) {
      mosaic = isMosaic(image);
      if (mosaic.value_or(false)) {
        warnings.emplace_back(
            "the images are mosaics of colours (Bayer): the mean over its neighbours, with the "
            "weights 1 2 1, replaces each pixel");
      }
    }
    if (mosaic.value_or(false)) image = greyOfMosaic(image);
  }

  std::optional<SourceImage> readSized(int index) {
    std::optional<SourceImage> image = read(index);
    if (!image || image->pixels.size() == inputSize()) return image;
    throw fileError(dataset.images->name(image->index),
                    "{}; expected {} as calibrated",
                    pixelText(image->pixels.cols, image->pixels.rows),
                    pixelText(rectifier->inputWidth(), rectifier->inputHeight()));
  }

  /// Depth and rotation that are known beside the image.
  std::shared_ptr<const FramePriors> priorsOf(const SequenceFrame& frame, const FrameInfo& info) {
    std::shared_ptr<FramePriors> priors;
    if (!depths.empty()) {
      const PinholeCamera& camera = rectifier->camera();
      priors = depthOf(frame.image_file, depths, depth_sigma, {camera.width, camera.height});
    }
    const auto last = std::exchange(before, std::make_pair(info.id, info.timestamp));
    if (!gyroscope || !last) return priors;
    const auto turn = gyroscope->between(last->first, last->second, info.timestamp);
    if (!turn) return priors;
    if (!priors) priors = std::make_shared<FramePriors>();
    priors->pose = turn;
    return priors;
  }

  std::optional<SequenceFrame> prepare(int index) {
    SequenceFrame result;
    auto start = std::chrono::steady_clock::now();
    std::optional<SourceImage> image;
    try {
      image = readSized(index);
    } catch (const IoError& error) {
      if (isStream()) throw;
      if (!skip_unreadable)
        throw IoError(fmt::format("{}; --skip-unreadable passes over such images", error.what()));
      result.image_file = dataset.images->name(index);
      result.warnings.push_back(fmt::format("{}; passed over", error.what()));
      return result;
    }
    if (!image || playlist.isAfterEnd(image->timestamp)) return std::nullopt;
    result.index = image->index;
    result.image_file = dataset.images->name(image->index);
    result.late = image->late;
    if (!image->warning.empty()) result.warnings.push_back(image->warning);
    demosaic(image->pixels, result.warnings);
    if (!combed && (combed = isInterlaced(image->pixels))) {
      result.warnings.push_back(fmt::format(
          "{}: interlaced, though nothing says so: every second row is of another moment; "
          "ffmpeg -i FILE -vf yadif NEW takes them apart",
          result.image_file));
    }
    leaveOutBars(image->pixels, result.warnings);
    const cv::Mat own = masks.empty() ? cv::Mat() : maskOf(result.image_file, masks, inputSize());
    if (image->pixels.depth() == CV_16U) chooseBits(image->pixels, result.warnings);
    const ImageView rectified = rectifier->rectify(rawImage(image->pixels), viewOf(own));
    FrameInfo info;
    const auto entry = static_cast<std::size_t>(image->index);
    info.id = FrameId{image->index};
    info.timestamp = image->timestamp ? *image->timestamp : dataset.timestamps[entry];
    if (!dataset.exposures.empty()) info.exposure = dataset.exposures[entry];
    info.response_slope = rectifier->responseSlope();
    info.row_times = rectifier->rowTimes();
    info.priors = priorsOf(result, info);
    result.read_milliseconds = millisecondsSince(start);

    start = std::chrono::steady_clock::now();
    result.frame = Frame::create(rectified, info);
    result.pyramid_milliseconds = millisecondsSince(start);
    return result;
  }

  DatasetLayout layout;
  Dataset dataset;
  bool skip_unreadable;
  bool keep_decoded;
  Playlist playlist;
  BrightnessModel brightness = BrightnessModel::kUncalibrated;
  std::optional<Rectifier> rectifier;
  Lens lens;
  cv::Mat mask;    // of all images; empty: none
  fs::path masks;  // folder with one for each image; empty: none
  BarFinder bars;
  fs::path depths;  // folder of the depth images; empty: none
  double depth_sigma = 0;
  std::optional<Gyroscope> gyroscope;
  std::optional<std::pair<FrameId, double>> before;  // the frame and its time
  std::optional<SourceImage> first;                  // decoded for its size, until it is read
  std::map<int, SourceImage> decoded;                // all that were read, or none
  std::size_t room = 0;                              // for more of them [bytes]
  std::optional<bool> mosaic;                        // empty: too dark to tell, so far
  bool combed = false;                               // an image is interlaced
  std::vector<std::string> unreadable;
  int bits = 0;                       // of 16-bit images; 0: not known before the first of them
  bool exceeded = false;              // by the values of one
  std::unique_ptr<FrameQueue> queue;  // last: its thread stops first
};

SequenceReader::SequenceReader(const SequenceOptions& options)
    : impl_(std::make_unique<Impl>(options)) {}
SequenceReader::SequenceReader(const SequenceOptions& options, SequenceReader before)
    : SequenceReader(options) {
  impl_->takeOver(*before.impl_);
}
SequenceReader::~SequenceReader() = default;
SequenceReader::SequenceReader(SequenceReader&&) noexcept = default;
SequenceReader& SequenceReader::operator=(SequenceReader&&) noexcept = default;

const PinholeCamera& SequenceReader::camera() const {
  return impl_->rectifier->camera();
}
const Lens& SequenceReader::lens() const {
  return impl_->lens;
}
int SequenceReader::size() const {
  return impl_->dataset.images->size();
}
int SequenceReader::selected() const {
  return impl_->selected();
}
SequenceFormat SequenceReader::format() const {
  return impl_->layout.format;
}
BrightnessModel SequenceReader::brightness() const {
  return impl_->brightness;
}
double SequenceReader::timestamp(int index) const {
  return impl_->dataset.timestamps.at(static_cast<std::size_t>(index));
}
const std::vector<std::string>& SequenceReader::warnings() const {
  return impl_->dataset.warnings;
}
int SequenceReader::index(int position) const {
  if (position < 0 || position >= selected()) {
    throw std::out_of_range(fmt::format("position {} of {} images", position, selected()));
  }
  return impl_->playlist.index(static_cast<std::size_t>(position));
}
int SequenceReader::dropped() const {
  return impl_->dataset.images->dropped();
}
const std::vector<std::string>& SequenceReader::unreadable() const {
  return impl_->unreadable;
}
void SequenceReader::skip(int images) {
  impl_->queue->skip(static_cast<std::size_t>(std::max(images, 0)));
}
/// Images that cannot be read are noted and passed over.
std::optional<SequenceFrame> SequenceReader::next() {
  std::vector<std::string> complaints;
  while (true) {
    std::optional<SequenceFrame> frame = impl_->queue->next();
    if (!frame) return frame;
    frame->warnings.insert(frame->warnings.begin(), complaints.begin(), complaints.end());
    if (frame->frame) return frame;
    impl_->unreadable.push_back(frame->image_file);
    complaints = std::move(frame->warnings);
  }
}

std::vector<float> readResponse(const fs::path& file) {
  const std::vector<TextLine> lines = readLines(file, kMaxCalibrationBytes);
  const std::string what = "at least 256 increasing numbers on one line";
  if (lines.empty()) throw fileError(file, "is empty; expected {}", what);
  const TextLine& line = lines.front();
  const std::vector<double> raw = line.numbers(splitWords(line.text), what);
  if (raw.size() < kMinResponseEntries) {
    throw line.error("{} numbers; expected {}", raw.size(), what);
  }
  std::vector<float> response;
  response.reserve(raw.size());
  const double range = raw.back() - raw.front();
  for (std::size_t i = 0; i < raw.size(); ++i) {
    response.push_back(static_cast<float>(255 * (raw[i] - raw.front()) / range));
    if (i > 0 && !(response[i] > response[i - 1] && raw[i] > raw[i - 1])) {
      throw line.error(
          "number {} ({}) is not above the one before; expected {}", i + 1, raw[i], what);
    }
  }
  return response;
}

void readVignette(const std::filesystem::path& file, PhotometricCalibration& calibration) {
  const cv::Mat image = decodeGrey(readFile(file), file.string());
  double maximum = 0;
  cv::minMaxLoc(image, nullptr, &maximum);
  if (maximum <= 0) throw fileError(file, "the vignette is black everywhere");
  cv::Mat attenuation;
  image.convertTo(attenuation, CV_32F, 1 / maximum);
  calibration.vignette_width = image.cols;
  calibration.vignette_height = image.rows;
  calibration.vignette.assign(attenuation.begin<float>(), attenuation.end<float>());
}

}  // namespace dsorb
