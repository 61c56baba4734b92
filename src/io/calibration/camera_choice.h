// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/io/calibration_reader.h"

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

namespace dsorb {

/// One camera of a calibration file.
struct NamedCamera {
  std::vector<std::string> names;  ///< the first one is that of messages; empty: it has none
  std::function<Calibration()> read;
};

/// The calibration of the camera that is chosen, or of all where they are the same.
/// @throws IoError that lists them where none is chosen, or one that is not there
[[nodiscard]] Calibration readChosen(const std::filesystem::path& file,
                                     const std::vector<NamedCamera>& cameras,
                                     const CameraChoice& choice);

}  // namespace dsorb
