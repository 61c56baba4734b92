// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/calibration.h"

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace dsorb {

/// Which camera of a calibration file is meant, where it has several.
struct CameraChoice {
  /// Its name in the file (cam1 of Kalibr, image_2 of KITTI, a number of COLMAP, a label), or the
  /// topic of its images, which begins with a slash; empty: not said.
  std::string name;
  /// Where nothing is said: one of the last folders of this path may be called as a camera is.
  std::filesystem::path images;
  int width = 0;   ///< of the images [px], which may tell raw from rectified ones; 0: not known
  int height = 0;  ///< of the images [px]
};

/// Lens and rectification of a calibration file of any known kind, told by suffix and content:
/// docs/calibration.md shows each. Nothing photometric is read.
/// @return a lens of size 0 where the file does not say it (KITTI odometry, some of OpenCV)
/// @throws IoError naming file, line, key and expectation, also where several cameras differ and
///         none of them is chosen
Calibration readCalibration(const std::filesystem::path& file, const CameraChoice& choice = {});

/// Largest readout either way that is believed [ms].
constexpr double kMaxReadoutMs = 1000;

/// Readout as calibrations and command lines say it: milliseconds, or "auto" for kUnknownReadout.
/// @return nothing for other text, and beyond kMaxReadoutMs
std::optional<Readout> parseReadout(std::string_view text);

/// Response table of pcalib.txt: at least 256 increasing numbers on its first line, any scale.
/// @return normalised to 0..255
/// @throws IoError naming file, line and expectation
std::vector<float> readResponse(const std::filesystem::path& file);

/// Vignette image of 8 or 16 bits, normalised to a maximum of 1, into `calibration`.
/// @throws IoError where it cannot be read or is black
void readVignette(const std::filesystem::path& file, PhotometricCalibration& calibration);

}  // namespace dsorb
