// SPDX-License-Identifier: BSD-3-Clause
#include "synthetic/sensor.h"

#include "base/parallel.h"
#include "base/random.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace dsorb::synthetic {
namespace {

// The inverse response of the simulated camera is a x + (1 - a) x^2 for x in [0, 1]: smooth,
// strictly increasing and exactly invertible, about as bent as the curves of real cameras.
constexpr double kLinearPart = 0.35;
// Brightness left in the corners: 1 - kVignetteSquare - kVignetteFourth.
constexpr double kVignetteSquare = 0.28;
constexpr double kVignetteFourth = 0.12;
constexpr std::size_t kTableSize = 4096;  // the forward response, for speed
constexpr std::size_t kRowsPerTask = 16;

}  // namespace

double forwardResponse(double irradiance, bool nonlinear) {
  const double y = std::clamp(irradiance / 255.0, 0.0, 1.0);
  if (!nonlinear) return 255.0 * y;
  const double curved = 1.0 - kLinearPart;
  return 255.0 * (std::sqrt(kLinearPart * kLinearPart + 4 * curved * y) - kLinearPart) /
         (2 * curved);
}

std::vector<double> makeInverseResponse(bool nonlinear) {
  std::vector<double> inverse(256);
  for (std::size_t value = 0; value < inverse.size(); ++value) {
    const double x = static_cast<double>(value) / 255.0;
    inverse[value] = 255.0 * (nonlinear ? kLinearPart * x + (1 - kLinearPart) * x * x : x);
  }
  return inverse;
}

std::vector<float> makeVignette(int width, int height, bool enabled) {
  std::vector<float> vignette(static_cast<std::size_t>(width) * static_cast<std::size_t>(height),
                              1.0F);
  if (!enabled) return vignette;
  const double middle_x = 0.5 * (width - 1);
  const double middle_y = 0.5 * (height - 1);
  const double corner = middle_x * middle_x + middle_y * middle_y;
  float* pixel = vignette.data();
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const double square =
          ((x - middle_x) * (x - middle_x) + (y - middle_y) * (y - middle_y)) / corner;
      *pixel++ =
          static_cast<float>(1 - kVignetteSquare * square - kVignetteFourth * square * square);
    }
  }
  return vignette;
}

std::vector<std::uint8_t> expose(const std::vector<float>& irradiance,
                                 const std::vector<float>& vignette,
                                 int width,
                                 const Exposure& exposure) {
  std::array<float, kTableSize + 2> response{};
  const float per_grey = static_cast<float>(kTableSize) / 255.0F;
  for (std::size_t i = 0; i < response.size(); ++i) {
    response[i] = static_cast<float>(forwardResponse(
        static_cast<double>(i) / static_cast<double>(per_grey), exposure.nonlinear));
  }
  const auto columns = static_cast<std::size_t>(width);
  const auto gain = static_cast<float>(exposure.gain);
  std::vector<std::uint8_t> image(irradiance.size());
  forEachRange(irradiance.size() / columns, kRowsPerTask, [&](std::size_t begin, std::size_t end) {
    for (std::size_t row = begin; row < end; ++row) {
      Random random(exposure.seed + 0x9E3779B97F4A7C15ULL * (row + 1));
      Random noise(random.next());
      for (std::size_t i = row * columns; i < (row + 1) * columns; ++i) {
        const float light = std::clamp(gain * irradiance[i] * vignette[i], 0.0F, 255.0F) * per_grey;
        const auto cell = static_cast<std::size_t>(light);
        const float part = light - static_cast<float>(cell);
        double value = response[cell] + part * (response[cell + 1] - response[cell]);
        if (exposure.noise_sigma > 0) value += exposure.noise_sigma * noise.gaussian();
        image[i] = static_cast<std::uint8_t>(std::clamp(value + 0.5, 0.0, 255.0));
      }
    }
  });
  return image;
}

}  // namespace dsorb::synthetic
