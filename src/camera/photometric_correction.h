// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/calibration.h"

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace dsorb {

constexpr std::size_t kMinResponseEntries = 256;

/// Turns raw images of 8 or 16 bits into corrected grey levels: G(Y) / V, or Y scaled to 0..255
/// where nothing is known about the camera. The exposure is not divided out.
/// @source Engel et al., DSO, arXiv:1607.02565, eq. (2) and (3)
class PhotometricCorrection {
 public:
  /// Without a calibration; grey levels are only scaled to 0..255.
  PhotometricCorrection(int width, int height);

  /// Corrects by a known response and vignette.
  /// @throws std::invalid_argument where the response has fewer than 256 entries or does not
  ///         increase, or the vignette is not of the image's size
  PhotometricCorrection(const PhotometricCalibration& calibration, int width, int height);

  /// The values of 16-bit images take so many bits only: the range of grey levels is spread over
  /// them, larger values count as the largest.
  /// @param bits 9 to 16
  void setBits(int bits);

  /// @tparam Pixel        std::uint8_t or std::uint16_t; a table of N entries covers the whole
  ///                      range of the type, or of its bits that are used
  /// @param stride_bytes  distance between the rows of `raw`
  /// @param corrected     width x height [grey levels, 0..255 times the vignette's gain]; NaN where
  ///                      the vignette lets nothing through
  template <typename Pixel>
  void apply(const Pixel* raw, std::size_t stride_bytes, float* corrected) const;

  /// Raw grey levels (0..255) per corrected grey level, by corrected grey level: slope B' of the
  /// forward response. 1 everywhere without calibration.
  [[nodiscard]] std::array<float, 256> responseSlope() const;

 private:
  template <typename Pixel>
  [[nodiscard]] const float* table() const;

  int width_;
  int height_;
  std::vector<float> response_;
  std::vector<float> table8_;   // corrected level by 8-bit value
  std::vector<float> table16_;  // corrected level by 16-bit value
  std::vector<float> gain_;     // 1 / V, NaN where V is nearly 0; empty: 1
};

}  // namespace dsorb
