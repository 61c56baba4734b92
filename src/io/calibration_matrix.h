// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/calibration.h"

#include <filesystem>
#include <string>

namespace YAML {
class Node;
}

namespace dsorb {

/// Whether a YAML document has a camera matrix.
[[nodiscard]] bool hasCameraMatrix(const YAML::Node& root);

/// Lens of ROS' camera_info (camera_matrix or K, distortion_coefficients or D, distortion_model) or
/// of a YAML file that cv::FileStorage wrote. A matrix is a list or a mapping with `data`.
/// @return a lens of size 0 where the file does not say it
/// @throws IoError naming file, line and key
[[nodiscard]] Calibration readMatrixYaml(const std::filesystem::path& file, const YAML::Node& root);

/// Lens of an XML file that cv::FileStorage wrote.
/// @throws IoError naming file, line and key
[[nodiscard]] Calibration readMatrixXml(const std::filesystem::path& file, const std::string& text);

}  // namespace dsorb
