// SPDX-License-Identifier: BSD-3-Clause
#include "io/sequence_calibration.h"

#include "dsorb/error.h"
#include "dsorb/io/calibration_reader.h"

#include <fmt/format.h>

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

Geometry readGeometry(const SequenceOptions& options,
                      const DatasetLayout& layout,
                      const FirstImage& first) {
  const cv::Size size = first.size;
  if (options.horizontal_view > 0) {
    if (!options.calibration_file.empty()) {
      throw ConfigError("a calibration file and a field of view are given; expected one of them");
    }
    if (size.empty()) {
      throw IoError(fmt::format("{}: the first image cannot be read", options.path));
    }
    Geometry geometry;
    geometry.calibration.rectification.mode = RectificationMode::kNone;
    geometry.calibration.lens = lensOfFieldOfView(options.horizontal_view, size.width, size.height);
    geometry.calibration.lens.fy *= first.pixel_aspect;
    geometry.source = "field of view";
    return geometry;
  }
  const std::string file = orDefault(options.calibration_file, layout.calibration);
  if (file.empty()) {
    throw IoError(
        fmt::format("{}: no calibration lies beside the images; give one with --calib, or what the "
                    "camera sees from left to right with --hfov DEGREES",
                    layout.images.string()));
  }
  return {readCalibration(file, layout.kitti_camera), file};
}

/// From the sensor's rows to the lines of an image that was turned clockwise.
void turnReadout(int degrees, Lens& lens) {
  lens.columns = degrees % 180 != 0;
  lens.backwards = degrees == 90 || degrees == 180;
}

/// The calibration for images of the size that they have and the width that is wanted.
void fit(const SequenceOptions& options,
         const FirstImage& first,
         Geometry& geometry,
         std::vector<std::string>& warnings) {
  Calibration& calibration = geometry.calibration;
  const Lens lens = calibration.lens;
  const cv::Size size = first.size;
  if (!size.empty()) calibration = calibrationForSize(calibration, size.width, size.height);
  if (lens.width > 0 && calibration.lens.width != lens.width) {
    warnings.push_back(fmt::format("{}: for images of {}x{} px, scaled to these of {}x{}",
                                   geometry.source,
                                   lens.width,
                                   lens.height,
                                   size.width,
                                   size.height));
  }
  if (options.width > 0) calibration = withOutputWidth(calibration, options.width);
  const bool known = calibration.lens.columns || calibration.lens.readout.seconds != 0;
  if (options.readout) calibration.lens.readout = *options.readout;
  if (!known) turnReadout(first.turn, calibration.lens);
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

SequenceCalibration calibrateSequence(const SequenceOptions& options,
                                      const DatasetLayout& layout,
                                      const FirstImage& first) {
  std::vector<std::string> warnings;
  Geometry geometry = readGeometry(options, layout, first);
  try {
    fit(options, first, geometry, warnings);
  } catch (const std::invalid_argument& error) {
    throw IoError(fmt::format("{}: {}", geometry.source, error.what()));
  }
  const std::string response = orDefault(options.response_file, layout.response);
  const std::string vignette = orDefault(options.vignette_file, layout.vignette);
  const BrightnessModel brightness = brightnessModel(options, response, vignette, warnings);
  if (brightness == BrightnessModel::kCalibrated) {
    geometry.calibration.photometric =
        readPhotometry(response, vignette, geometry.calibration.lens);
  }
  SequenceCalibration result{
      rectifierFor(geometry), geometry.calibration.lens, brightness, std::move(warnings)};
  for (const std::string& doubt : result.rectifier.warnings()) {
    result.warnings.push_back(fmt::format("{}: {}", geometry.source, doubt));
  }
  return result;
}

}  // namespace dsorb
