// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/io/calibration_reader.h"

#include "io/calibration/keyed_values.h"
#include "io/text_file.h"

#include <filesystem>
#include <vector>

// One pair of functions for each form of calibration files: whether it is one, and its lens, which
// has the size 0 where the file does not say it. All readers throw an IoError naming file, line and
// key.
namespace dsorb {

/// ROS' camera_info (camera_matrix or K, distortion_coefficients or D, distortion_model, binning,
/// roi), or what cv::FileStorage wrote. A matrix is a list, or a group with `data`.
[[nodiscard]] bool hasCameraMatrix(const io::KeyedValues& values);
[[nodiscard]] Calibration readMatrices(const io::KeyedValues& values, const CameraChoice& choice);

/// EuRoC's sensor.yaml or Kalibr's camchain.yaml.
[[nodiscard]] bool isKalibr(const io::KeyedValues& values);
[[nodiscard]] Calibration readKalibr(const io::KeyedValues& values, const CameraChoice& choice);

/// Settings of ORB-SLAM2 and 3, stella_vslam, VINS, SVO, Basalt, nerfstudio or instant-ngp; others
/// are refused.
[[nodiscard]] Calibration readSettings(const io::KeyedValues& values, const CameraChoice& choice);

/// KITTI's calib.txt, where image_2 is P2, and calib_cam_to_cam.txt, where image_02 is P_rect_02,
/// or K_02 and D_02 for images of the size of raw ones.
[[nodiscard]] bool isKitti(const std::vector<TextLine>& lines);
[[nodiscard]] Calibration readKitti(const std::filesystem::path& file,
                                    const std::vector<TextLine>& lines,
                                    const CameraChoice& choice);

/// COLMAP's cameras.txt: lines of a number, a name in capitals, and more. Its pixels have their
/// centres at .5.
[[nodiscard]] bool isColmap(const std::vector<TextLine>& lines);
[[nodiscard]] Calibration readColmap(const std::filesystem::path& file,
                                     const std::vector<TextLine>& lines,
                                     const CameraChoice& choice);

}  // namespace dsorb
