// SPDX-License-Identifier: BSD-3-Clause
// Stands for a camera driver: raw grey images of a corridor.
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

/// Where the ray of a pixel of image i meets the scene: depth along the optical axis and texture.
struct Hit {
  double depth;
  double s, t;  // coordinates on the surface
};

inline Hit castRay(double u, double v, int i) {
  const double x = (u - kWidth / 2.0) / kFocal, y = (v - kHeight / 2.0) / kFocal;
  const double wall_x = x > 0 ? 2.0 : -1.5;
  const double wall = std::abs(x) > 1e-9 ? (wall_x - cameraX(i)) / x : 1e9;
  const double floor = std::abs(y) > 1e-9 ? (y > 0 ? 1.2 : -1.6) / y : 1e9;
  const double back = 9.0 - cameraZ(i);
  if (wall < floor && wall < back) return {wall, wall + cameraZ(i), wall * y + 20};
  if (floor < back) return {floor, floor * x + cameraX(i) + (y > 0 ? 40 : 80), floor + cameraZ(i)};
  return {back, back * x + cameraX(i) + 60, back * y + 30};
}

inline double depth(double u, double v, int i) {
  return castRay(u, v, i).depth;
}

inline std::vector<std::uint8_t> grabImage(int i) {
  std::vector<std::uint8_t> image;
  image.reserve(static_cast<std::size_t>(kWidth) * kHeight);
  for (int v = 0; v < kHeight; ++v) {
    for (int u = 0; u < kWidth; ++u) {
      const Hit hit = castRay(u, v, i);
      const double fine = std::min(1.0, 4.0 / hit.depth);  // far away the fine grain would alias
      const double grey = 0.5 + 0.6 * (noise(5 * hit.s, 5 * hit.t, 1) - 0.5) +
                          0.4 * fine * (noise(15 * hit.s, 15 * hit.t, 2) - 0.5);
      image.push_back(static_cast<std::uint8_t>(std::lround(20 + 215 * grey)));
    }
  }
  return image;
}
