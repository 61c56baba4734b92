// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/calibration.h"

#include <filesystem>

namespace dsorb {

/// Lens of an EuRoC sensor.yaml, of cam0 in a Kalibr camchain.yaml, of ROS' camera_info, or of a
/// file that cv::FileStorage wrote. None names an output camera: cropped at the input size.
/// @throws IoError naming file, line, key and expectation
Calibration readYamlCalibration(const std::filesystem::path& file);

}  // namespace dsorb
