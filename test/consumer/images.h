// SPDX-License-Identifier: BSD-3-Clause
// Stands for a camera driver: raw grey images of a corner between a floor and two walls.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

constexpr int kWidth = 640;
constexpr int kHeight = 480;
constexpr double kFocal = 500;  // [px]

/// Where the camera is at image i: it moves sideways and forward, without turning.
inline double cameraX(int i) {
  return 0.06 * i;
}
inline double cameraZ(int i) {
  return 0.03 * i;
}

/// Smooth pseudo-random texture in [0, 1].
inline double noise(double u, double v, unsigned seed) {
  const auto value = [seed](long x, long y) {
    unsigned h =
        static_cast<unsigned>(x) * 374761393U + static_cast<unsigned>(y) * 668265263U + seed;
    h = (h ^ (h >> 13U)) * 1274126177U;
    return static_cast<double>((h ^ (h >> 16U)) & 0xFFFFU) / 65535.0;
  };
  const long x = std::lround(std::floor(u)), y = std::lround(std::floor(v));
  const double a = u - static_cast<double>(x), b = v - static_cast<double>(y);
  const double sa = a * a * (3 - 2 * a), sb = b * b * (3 - 2 * b);
  return (1 - sb) * ((1 - sa) * value(x, y) + sa * value(x + 1, y)) +
         sb * ((1 - sa) * value(x, y + 1) + sa * value(x + 1, y + 1));
}

/// Depth along the optical axis of a pixel of image i [unit].
inline double depth(double u, double v, int i) {
  const double x = (u - kWidth / 2.0) / kFocal, y = (v - kHeight / 2.0) / kFocal;
  const double floor_depth = y > 0 ? 1.2 / y : 1e9;                // plane y = 1.2
  const double side_depth = x > 0 ? (2.0 - cameraX(i)) / x : 1e9;  // plane x = 2
  return std::min({floor_depth, side_depth, 6.0 - cameraZ(i)});    // plane z = 6
}

inline std::vector<std::uint8_t> grabImage(int i) {
  std::vector<std::uint8_t> image;
  image.reserve(static_cast<std::size_t>(kWidth) * kHeight);
  for (int v = 0; v < kHeight; ++v) {
    for (int u = 0; u < kWidth; ++u) {
      const double z = depth(u, v, i);
      const double x = (u - kWidth / 2.0) / kFocal * z + cameraX(i);
      const double y = (v - kHeight / 2.0) / kFocal * z;
      const double s = x + 0.7 * (z + cameraZ(i)), t = y + 0.6 * (z + cameraZ(i));
      const double grey = 0.6 * noise(4 * s, 4 * t, 1) + 0.4 * noise(11 * s, 11 * t, 2);
      image.push_back(static_cast<std::uint8_t>(std::lround(20 + 215 * grey)));
    }
  }
  return image;
}
