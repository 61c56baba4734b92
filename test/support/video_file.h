// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>
#include <opencv2/videoio.hpp>

#include <filesystem>
#include <functional>
#include <string>

namespace dsorb {

/// Encodes images as a video.
/// @param codec four characters: MJPG, avc1 (H.264), mp4v
/// @param image of 8 bits, BGR, by its position
/// @return false where this OpenCV has no such encoder
inline bool writeVideo(const std::filesystem::path& file,
                       const std::string& codec,
                       double rate,
                       int count,
                       const std::function<cv::Mat(int)>& image) {
  const int fourcc = cv::VideoWriter::fourcc(codec[0], codec[1], codec[2], codec[3]);
  cv::VideoWriter writer(file.string(), cv::CAP_FFMPEG, fourcc, rate, image(0).size());
  if (!writer.isOpened()) return false;
  for (int i = 0; i < count; ++i) writer.write(image(i));
  return true;
}

}  // namespace dsorb
