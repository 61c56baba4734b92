// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/io/calibration_reader.h"

#include "io/keyed_values.h"

namespace dsorb {

/// Whether a file is EuRoC's sensor.yaml or Kalibr's camchain.yaml.
[[nodiscard]] bool isKalibr(const io::KeyedValues& values);

/// Lens of such a file.
/// @throws IoError naming file, line and key
[[nodiscard]] Calibration readKalibr(const io::KeyedValues& values, const CameraChoice& choice);

}  // namespace dsorb
