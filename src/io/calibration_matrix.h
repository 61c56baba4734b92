// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/io/calibration_reader.h"

#include "io/keyed_values.h"

namespace dsorb {

/// Whether a file has a camera matrix.
[[nodiscard]] bool hasCameraMatrix(const io::KeyedValues& values);

/// Lens of ROS' camera_info (camera_matrix or K, distortion_coefficients or D, distortion_model,
/// binning, roi), or of a file that cv::FileStorage wrote. A matrix is a list, or a group with
/// `data`.
/// @return a lens of size 0 where the file does not say it
/// @throws IoError naming file, line and key
[[nodiscard]] Calibration readMatrices(const io::KeyedValues& values, const CameraChoice& choice);

}  // namespace dsorb
