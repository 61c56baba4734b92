// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/io/calibration_reader.h"

#include "io/text_file.h"

#include <filesystem>
#include <vector>

namespace dsorb {

/// Whether lines are those of KITTI: calib.txt of its odometry, or calib_cam_to_cam.txt.
[[nodiscard]] bool isKitti(const std::vector<TextLine>& lines);

/// A camera of such a file: image_2 is P2 of the first, image_02 is P_rect_02 of the other, or K_02
/// and D_02 for images of the size of raw ones. The first does not say the size of images.
/// @throws IoError naming file and line
[[nodiscard]] Calibration readKitti(const std::filesystem::path& file,
                                    const std::vector<TextLine>& lines,
                                    const CameraChoice& choice);

}  // namespace dsorb
