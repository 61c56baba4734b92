// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <vector>

namespace dsorb::synthetic {

/// Pixel value of a light intensity; the curve of the simulated camera, or a straight line.
/// @param irradiance [grey levels]; clipped to [0, 255] @return [grey levels], not rounded
[[nodiscard]] double forwardResponse(double irradiance, bool nonlinear);

/// Light intensity of the pixel values 0 to 255 [grey levels, 0 to 255], strictly increasing.
[[nodiscard]] std::vector<double> makeInverseResponse(bool nonlinear);

/// Share of the light that arrives at each pixel, 1 in the middle; all 1 without vignette.
[[nodiscard]] std::vector<float> makeVignette(int width, int height, bool enabled);

/// Settings of one exposure.
struct Exposure {
  double gain = 1;         ///< exposure time over the nominal one
  bool nonlinear = false;  ///< response
  double noise_sigma = 0;  ///< [grey levels]
  std::uint64_t seed = 0;  ///< of the noise
};

/// Turns light into pixel values: vignette, exposure, response, noise, rounding.
/// @param irradiance [grey levels] row-major @param vignette of the same size
[[nodiscard]] std::vector<std::uint8_t> expose(const std::vector<float>& irradiance,
                                               const std::vector<float>& vignette,
                                               int width,
                                               const Exposure& exposure);

}  // namespace dsorb::synthetic
