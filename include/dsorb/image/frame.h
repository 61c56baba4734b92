// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/row_times.h"
#include "dsorb/image/pyramid.h"

#include <array>
#include <cstdint>
#include <memory>

namespace dsorb {

/// Position of an image in its sequence, or any number that is unique among the frames given.
struct FrameId {
  int value = -1;  ///< the number itself; below 0: none
  /// Compares the numbers, as the other comparisons do.
  friend bool operator==(FrameId l, FrameId r) { return l.value == r.value; }
  friend bool operator!=(FrameId l, FrameId r) { return l.value != r.value; }  ///< by number
  friend bool operator<(FrameId l, FrameId r) { return l.value < r.value; }    ///< by number
};

/// Factor from gradients of corrected grey levels to gradients of raw camera values, by corrected
/// grey level: slope of the forward response. Selecting pixels by raw gradients makes the choice
/// depend on image noise and not on the response curve.
using ResponseSlope = std::array<float, 256>;

/// Time of a frame from a clock that counts nanoseconds, as those of ROS and EuRoC.
/// @return within one unit in the last place [s]; of times since 1970 it keeps steps of a quarter
/// microsecond
[[nodiscard]] constexpr double secondsFromNanoseconds(std::int64_t nanoseconds) {
  constexpr std::int64_t kPerSecond = 1000000000;
  const std::int64_t seconds = nanoseconds / kPerSecond;
  return static_cast<double>(seconds) +
         static_cast<double>(nanoseconds - seconds * kPerSecond) / static_cast<double>(kPerSecond);
}

struct FramePriors;  // dsorb/image/frame_priors.h

/// What a frame knows beside its image.
struct FrameInfo {
  FrameId id;            ///< unique among the frames given
  double timestamp = 0;  ///< time of the middle row [s]; secondsFromNanoseconds()
  double exposure = 1;   ///< [s]; 1 when unknown
  std::shared_ptr<const ResponseSlope> response_slope = nullptr;  ///< null: the response is linear
  std::shared_ptr<const RowTimes> row_times = nullptr;            ///< null: global shutter
  std::shared_ptr<const FramePriors> priors = nullptr;  ///< what the caller knows; null: nothing
};

class Frame;
/// Frames are shared and never change.
using FramePtr = std::shared_ptr<const Frame>;

/// One image with its pyramid; immutable, safe to share between threads. Poses and brightness
/// estimates live beside it.
class Frame {
 public:
  /// @param image rectified and photometrically corrected, 8-bit or float (NaN marks invalid
  /// pixels)
  /// @throws std::invalid_argument on an empty or too small image
  static FramePtr create(const ImageView& image, const FrameInfo& info) {
    return std::make_shared<const Frame>(image, info);
  }
  /// Makes the frame as create() does.
  Frame(const ImageView& image, const FrameInfo& info) : info_(info), pyramid_(image) {}

  /// Identity that the caller gave.
  [[nodiscard]] FrameId id() const { return info_.id; }
  /// Time of the middle row [s].
  [[nodiscard]] double timestamp() const { return info_.timestamp; }
  /// Exposure time [s]; 1 when unknown.
  [[nodiscard]] double exposure() const { return info_.exposure; }
  /// Slope of the response; null where the response is linear.
  [[nodiscard]] const ResponseSlope* responseSlope() const { return info_.response_slope.get(); }
  /// Times of the rows; null where all pixels were exposed at the time stamp.
  [[nodiscard]] const RowTimes* rowTimes() const { return info_.row_times.get(); }
  /// What the caller knows beside the image; null where it is nothing.
  [[nodiscard]] const FramePriors* priors() const { return info_.priors.get(); }
  /// All levels.
  [[nodiscard]] const Pyramid& pyramid() const { return pyramid_; }
  /// @param index of the level; 0: the image itself
  [[nodiscard]] const PyramidLevel& level(int index) const { return pyramid_.level(index); }
  /// Width of level 0 [px].
  [[nodiscard]] int width() const { return pyramid_.width(); }
  /// Height of level 0 [px].
  [[nodiscard]] int height() const { return pyramid_.height(); }

 private:
  FrameInfo info_;
  Pyramid pyramid_;
};

}  // namespace dsorb
