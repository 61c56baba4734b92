// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "io/input/capture.h"

#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace dsorb {

/// Functions of the module that is linked with OpenCV's imgcodecs and videoio, and with FFmpeg. It
/// is linked with no library of ours, so they throw none of our errors.
struct CodecsModule {
  /// @return empty where it cannot
  cv::Mat (*decode)(const std::vector<std::uint8_t>& bytes);
  /// @return null where nothing that decodes is there, and `why`
  std::unique_ptr<Capture> (*open_capture)(const std::string& address, std::string& why);
};

/// Opens a video file, or an address like rtsp://..., by FFmpeg's libraries.
/// @param why what is wrong, where nothing that decodes is there
/// @return null where nothing that decodes is there
std::unique_ptr<Capture> openFfmpegCapture(const std::string& address, std::string& why);

}  // namespace dsorb

extern "C" __attribute__((visibility("default"))) const dsorb::CodecsModule* dsorbCodecsModule();
