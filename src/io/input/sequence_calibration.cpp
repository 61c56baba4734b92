// SPDX-License-Identifier: BSD-3-Clause
#include "io/input/sequence_calibration.h"

#include "dsorb/error.h"
#include "dsorb/io/calibration_reader.h"

#include "camera/lens_models.h"

#include <fmt/format.h>

#include <algorithm>
#include <new>
#include <stdexcept>
#include <utility>

namespace dsorb {
namespace {

std::string orDefault(const std::string& given, const std::filesystem::path& found) {
  return given.empty() ? found.string() : given;
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
    if (!std::filesystem::exists(alone)) throw IoError(alone + ": cannot be read");
    warnings.push_back(fmt::format("{}: not used; {}", alone, missing));
  }
  return BrightnessModel::kUncalibrated;
}

/// Lens and rectification, and where they come from.
struct Geometry {
  Calibration calibration;
  std::string source;
};

Geometry geometryOf(const Lens& lens, const std::string& source) {
  Geometry geometry;
  geometry.calibration.lens = lens;
  if (!isDistorted(lens)) geometry.calibration.rectification.mode = RectificationMode::kNone;
  geometry.source = source;
  return geometry;
}

Geometry readGeometry(const SequenceOptions& options,
                      const DatasetLayout& layout,
                      const FirstImage& first) {
  const cv::Size size = first.size;
  if (options.lens) return geometryOf(*options.lens, "lens");
  if (isGuess(options, layout)) {
    const bool stated = options.horizontal_view > 0;
    if (!options.calibration_file.empty() || !options.camera.empty()) {
      throw ConfigError(stated
                            ? "a calibration file or a camera of one, and a field of view are "
                              "given; expected one of them"
                            : "--camera " + options.camera + ": there is no calibration with it");
    }
    if (size.empty()) {
      throw IoError(fmt::format("{}: the first image cannot be read", options.path));
    }
    Lens lens = stated ? lensOfFieldOfView(options.horizontal_view, size.width, size.height)
                       : unknownLens(size.width, size.height);
    lens.fy *= first.pixel_aspect;
    return geometryOf(lens, stated ? "field of view" : "unknown camera");
  }
  const std::string file = orDefault(options.calibration_file, layout.calibration);
  const CameraChoice choice{options.camera, layout.images, size.width, size.height};
  return {readCalibration(file, choice), file};
}

/// Width that images get; 0: as the calibration says.
int outputWidth(const SequenceOptions& options, const Lens& lens) {
  const bool calibrated = !options.lens && lens.focal_sigma == 0;
  const int side = std::max(lens.width, lens.height);
  if (options.width >= 0 || calibrated || side <= kMostGuessedSide) return options.width;
  return lens.width * kMostGuessedSide / side;
}

bool isUpright(double width, double height) {
  return height > width;
}

/// How far the calibration must be turned with the images, which the sensor has otherwise: not at
/// all where it has the shape of images that were turned to the side.
int turnOf(const SequenceOptions& options, const FirstImage& first, const Lens& lens) {
  if (first.size.empty() || options.lens || lens.focal_sigma > 0) return 0;
  const bool upright =
      lens.width > 0 ? isUpright(lens.width, lens.height) : isUpright(lens.cx, lens.cy);
  const bool same = upright == isUpright(first.size.width, first.size.height);
  const bool square = first.size.width == first.size.height;
  return first.turn % 180 != 0 && same && !square ? 0 : first.turn;
}

/// The calibration for images of the size that they have.
void fitSize(cv::Size size, Geometry& geometry, std::vector<std::string>& warnings) {
  Calibration& calibration = geometry.calibration;
  const Lens lens = calibration.lens;
  if (size.empty()) return;
  calibration = calibrationForSize(calibration, size.width, size.height);
  if (lens.width == 0 || calibration.lens.width == lens.width) return;
  warnings.push_back(fmt::format("{}: for images of {}x{} px, scaled to these of {}x{}",
                                 geometry.source,
                                 lens.width,
                                 lens.height,
                                 size.width,
                                 size.height));
}

/// The calibration for images that were turned, and for the width that is wanted.
void fitOutput(const SequenceOptions& options,
               int image_turn,
               int turn,
               Geometry& geometry,
               std::vector<std::string>& warnings) {
  Calibration& calibration = geometry.calibration;
  const bool known = calibration.lens.columns || calibration.lens.readout.seconds != 0;
  if (turn != 0) {
    calibration = turned(calibration, turn);
    warnings.push_back(
        fmt::format("{}: the images were turned by {} degrees to be upright; the "
                    "calibration is taken to be the sensor's and turned with them",
                    geometry.source,
                    turn));
  }
  const int width = outputWidth(options, calibration.lens);
  if (width > 0) calibration = withOutputWidth(calibration, width);
  if (options.readout) calibration.lens.readout = *options.readout;
  if (!known && turn == 0 && !options.lens) turnReadout(image_turn, calibration.lens);
}

PhotometricCalibration readPhotometry(const std::string& response,
                                      const std::string& vignette,
                                      const Lens& lens) {
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
  return photometric;
}

/// @throws IoError naming the file that the calibration comes from
Rectifier rectifierFor(const Geometry& geometry) {
  try {
    return Rectifier(geometry.calibration);
  } catch (const std::invalid_argument& error) {
    throw IoError(fmt::format("{}: {}", geometry.source, error.what()));
  } catch (const std::bad_alloc&) {
    throw IoError(fmt::format("{}: no memory for images of this size", geometry.source));
  }
}

}  // namespace

bool isGuess(const SequenceOptions& options, const DatasetLayout& layout) {
  return options.horizontal_view > 0 ||
         orDefault(options.calibration_file, layout.calibration).empty();
}

SequenceCalibration calibrateSequence(const SequenceOptions& options,
                                      const DatasetLayout& layout,
                                      const FirstImage& first) {
  std::vector<std::string> warnings;
  Geometry geometry = readGeometry(options, layout, first);
  if (options.horizontal_view > 0 && isUpright(first.size.width, first.size.height)) {
    warnings.push_back(
        "the images are upright: --hfov is what they show from left to right, along "
        "their short side");
  }
  const std::string response = orDefault(options.response_file, layout.response);
  const std::string vignette = orDefault(options.vignette_file, layout.vignette);
  const BrightnessModel brightness = brightnessModel(options, response, vignette, warnings);
  const int turn = turnOf(options, first, geometry.calibration.lens);
  const bool sideways = turn % 180 != 0;
  try {
    fitSize(
        sideways ? cv::Size(first.size.height, first.size.width) : first.size, geometry, warnings);
    if (brightness == BrightnessModel::kCalibrated) {
      geometry.calibration.photometric =
          readPhotometry(response, vignette, geometry.calibration.lens);
    }
    fitOutput(options, first.turn, turn, geometry, warnings);
    const Lens& lens = geometry.calibration.lens;
    const int width = outputWidth(options, lens);
    if (width > 0 && width != options.width) {
      warnings.push_back(
          fmt::format("images of {}x{} px are made smaller, to a width of {}; --width 0 keeps them",
                      lens.width,
                      lens.height,
                      width));
    }
  } catch (const std::invalid_argument& error) {
    throw IoError(fmt::format("{}: {}", geometry.source, error.what()));
  }
  SequenceCalibration result{
      rectifierFor(geometry), geometry.calibration.lens, brightness, std::move(warnings)};
  for (const std::string& doubt : result.rectifier.warnings()) {
    result.warnings.push_back(fmt::format("{}: {}", geometry.source, doubt));
  }
  return result;
}

}  // namespace dsorb
