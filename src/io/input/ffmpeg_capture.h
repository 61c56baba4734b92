// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "io/input/capture.h"

#include <memory>
#include <string>

namespace dsorb {

/// Opens a video file, or an address like rtsp://..., by FFmpeg's libraries.
/// @param why what is wrong, where nothing that decodes is there
/// @return null where nothing that decodes is there
std::unique_ptr<Capture> openFfmpegCapture(const std::string& address, std::string& why);

}  // namespace dsorb
