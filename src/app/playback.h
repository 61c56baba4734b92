// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

namespace dsorb::app {

/// Plays a sequence back like a live camera (kCameraBuffers). It has no clock; the caller passes
/// the time.
class Playback {
 public:
  /// @param timestamps of the images in the order they are played [s]; direction does not matter
  /// @param speed      times real time; 0: every image, at once
  Playback(std::vector<double> timestamps, double speed);

  struct Step {
    double wait = 0;    ///< until the next image is there [s]; 0: take it now
    int drop = 0;       ///< number of images before it that are dropped
    bool late = false;  ///< the image behind it is there, too
  };
  /// Tells what to do about the next image. Time starts at the first call. When there is nothing to
  /// wait for the image counts as taken.
  /// @param now [s], of any clock that does not run backwards
  [[nodiscard]] Step next(double now);

  [[nodiscard]] int dropped() const { return dropped_; }

 private:
  std::vector<double> due_;  ///< since the first image [s]
  std::optional<double> begin_;
  std::size_t position_ = 0;
  int dropped_ = 0;
};

}  // namespace dsorb::app
