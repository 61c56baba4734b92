// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/calibration.h"

#include <filesystem>
#include <optional>
#include <string_view>
#include <vector>

namespace dsorb {

/// Lens and rectification of a calibration file of any known kind, told by suffix and content:
/// EuRoC sensor.yaml, Kalibr camchain.yaml, ROS camera_info, YAML or XML of cv::FileStorage, KITTI
/// calib.txt, COLMAP cameras.txt, else the camera.txt of DSO. docs/calibration.md shows each.
/// Nothing photometric is read.
/// @param kitti_camera  which line of a KITTI file: that of image_0 ... image_3
/// @return a lens of size 0 where the file does not say it (KITTI, some files of OpenCV)
/// @throws IoError naming file, line, key and expectation
Calibration readCalibration(const std::filesystem::path& file, int kitti_camera = 0);

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
