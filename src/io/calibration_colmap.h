// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/io/calibration_reader.h"

#include "io/text_file.h"

#include <filesystem>
#include <vector>

namespace dsorb {

/// Whether lines are those of COLMAP's cameras.txt: a number, a name in capitals, and more.
[[nodiscard]] bool isColmap(const std::vector<TextLine>& lines);

/// A camera of COLMAP's cameras.txt, chosen by its number. COLMAP's pixels have their centres at
/// .5.
/// @throws IoError naming file and line, also where the model is none of ours
[[nodiscard]] Calibration readColmap(const std::filesystem::path& file,
                                     const std::vector<TextLine>& lines,
                                     const CameraChoice& choice);

}  // namespace dsorb
