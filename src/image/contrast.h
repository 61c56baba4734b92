// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/affine_brightness.h"
#include "dsorb/image/frame.h"

#include <optional>

namespace dsorb {

/// Least standard deviation of an image's grey values that tells the gain to another one [grey
/// levels].
constexpr double kContrastOfGain = 5;

/// Line through pairs of grey values, by weighted least squares.
class GreyLine {
 public:
  void add(double from, double to, double weight = 1) {
    n_ += weight;
    x_ += weight * from;
    y_ += weight * to;
    xx_ += weight * from * from;
    xy_ += weight * from * to;
  }
  /// @return nullopt where the contrast is too low to tell the gain
  [[nodiscard]] std::optional<BrightnessTransfer> transfer() const {
    const double variance = xx_ / n_ - x_ / n_ * (x_ / n_);
    if (!(variance > kContrastOfGain * kContrastOfGain)) return std::nullopt;
    const double gain = (xy_ / n_ - x_ / n_ * (y_ / n_)) / variance;
    return BrightnessTransfer{gain, (y_ - gain * x_) / n_};
  }
  [[nodiscard]] double weight() const { return n_; }

 private:
  double n_ = 0, x_ = 0, y_ = 0, xx_ = 0, xy_ = 0;
};

/// Whether a frame shows next to nothing beside another one of its camera: black, covered,
/// overexposed or full of noise alone. A shorter exposure excuses it.
[[nodiscard]] bool isBlank(const Frame& frame, const Frame& beside);

/// Whether a frame shows the very image of another one of its camera, exactly or as it is encoded
/// again: a video of a variable rate, a frozen stream.
[[nodiscard]] bool isRepeated(const Frame& frame, const Frame& before);

/// Standard deviation of a pixel's noise, by what planes leave of the median 3 x 3 neighbourhood;
/// fine texture counts as noise [grey levels].
/// @source Immerkaer, Fast noise variance estimation, CVIU 1996, with a median
[[nodiscard]] double noiseOf(const PyramidLevel& level);

/// From the intensities of images to the grey levels that thresholds are meant in. Images of usual
/// contrast are left as they are; those of little (thermal, fog, a small part of 16 bits) and of
/// much get the usual one, unless that would show the noise.
struct GreyScale {
  float gain = 1;
  float offset = 0;  ///< [grey levels]

  [[nodiscard]] bool changes() const { return gain != 1 || offset != 0; }
  /// Grey levels of the images of a camera, by one of them; nullopt where it shows nothing.
  [[nodiscard]] static std::optional<GreyScale> of(const Frame& frame);
  /// Whether it leaves an image of its camera usual grey levels: one of darkness does not suit the
  /// light that comes back.
  [[nodiscard]] bool suits(const Frame& frame) const;
  /// The same frame in other grey levels. The slope of its response is forgotten.
  [[nodiscard]] FramePtr apply(const FramePtr& frame) const;
};

}  // namespace dsorb
