// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/odometry/observer.h"

#include <string>

namespace dsorb::io {

/// First line of frames.csv.
[[nodiscard]] std::string frameTableHeader();

/// Line of a frame; what does not exist or is not finite is an empty field.
[[nodiscard]] std::string frameTableLine(const FrameEstimate& estimate,
                                         double milliseconds,
                                         const std::string& image_file);

}  // namespace dsorb::io
