// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "io/input/image_source.h"

#include <filesystem>
#include <memory>
#include <string>

namespace dsorb {

/// A video file: goes forwards only, times from its container.
class VideoSource : public ImageSource {
 public:
  /// Rate of the images as the container announces it [1/s].
  [[nodiscard]] virtual double rate() const = 0;
  /// Time of the first image [s].
  [[nodiscard]] virtual double begin() const = 0;
};

/// Whether a path is /dev/videoN or an address like rtsp://...
[[nodiscard]] bool isCameraAddress(const std::string& path);

/// @throws IoError where it cannot be decoded or holds no image, or this build reads no videos.
///         image() throws where the file ends long before the end that its container announces.
[[nodiscard]] std::unique_ptr<VideoSource> openVideo(const std::filesystem::path& file);

/// A device, an address, or a video file that is played like a camera in its own time. A thread
/// takes every image; image() waits for one that is newer than the last and never gives an older
/// one than the newest. Times are seconds since 1970, of a file those of its container.
/// The end of its life takes up to half a second where an image is being read; a read that does not
/// return is left to its thread, which ends with it.
/// @throws IoError where it cannot be opened within ten seconds, and from image() where nothing
///         comes for five seconds or the camera goes away
[[nodiscard]] std::unique_ptr<ImageSource> openCamera(const std::string& address);

}  // namespace dsorb
