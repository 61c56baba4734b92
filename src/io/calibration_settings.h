// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/io/calibration_reader.h"

#include "io/keyed_values.h"

namespace dsorb {

/// Lens of a settings file of ORB-SLAM2 and 3, stella_vslam, VINS, SVO, Basalt or nerfstudio.
/// @throws IoError naming file, line and key, also where it is none of these
[[nodiscard]] Calibration readSettings(const io::KeyedValues& values, const CameraChoice& choice);

}  // namespace dsorb
