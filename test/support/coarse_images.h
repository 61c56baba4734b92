// SPDX-License-Identifier: BSD-3-Clause
// Images, points and motions for tests of the coarse initializer's alignment.
#pragma once

#include "dsorb/image/pyramid.h"

#include "base/random.h"
#include "estimate/sampling.h"
#include "image/photometric.h"
#include "init/coarse/coarse_alignment.h"

#include <cmath>
#include <cstdint>
#include <vector>

namespace dsorb::init_coarse {

constexpr int kWidth = 160;
constexpr int kHeight = 120;
inline const PinholeCamera kCamera{130, 125, 81.3, 58.7, kWidth, kHeight};

/// Smooth texture; wavelengths of 25 px and more, so that central differences are derivatives.
inline float texture(double x, double y) {
  return static_cast<float>(120 + 25 * std::sin(0.21 * x + 0.07 * y) +
                            20 * std::sin(0.23 * y - 0.05 * x + 1) + 15 * std::cos(0.13 * (x + y)));
}

/// The texture, or one grey level where `flat` is not negative.
/// @param shift of the texture to the left [px]
inline Pyramid texturedPyramid(double shift, float flat = -1) {
  std::vector<float> pixels;
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) pixels.push_back(flat < 0 ? texture(x + shift, y) : flat);
  }
  return Pyramid(ImageView(pixels.data(), kWidth, kHeight));
}

inline std::vector<SelectedPixel> gridPixels(int step) {
  std::vector<SelectedPixel> pixels;
  for (int y = 20; y < kHeight - 20; y += step) {
    for (int x = 20; x < kWidth - 20; x += step) pixels.push_back({x, y, 1});
  }
  return pixels;
}

inline Alignment someMotion() {
  Alignment alignment;
  Vector6d xi;
  xi << 0.03, -0.02, 0.04, 0.01, -0.015, 0.02;
  alignment.T_cur_ref = SE3::exp(xi);
  return alignment;
}

inline Alignment movedBy(const Alignment& alignment, const Eigen::VectorXd& step) {
  Alignment result = alignment;
  result.T_cur_ref = SE3::exp(step.head<6>()) * alignment.T_cur_ref;
  result.log_gain += step[6];
  result.offset += step[7];
  return result;
}

/// Makes the residuals of all points 0 at an alignment with gain 1 and offset 0.
inline void matchReference(const PyramidLevel& image,
                           const Alignment& alignment,
                           PointLevel& points) {
  for (std::size_t i = 0; i < points.x.size(); ++i) {
    for (std::size_t k = 0; k < kPatternSize; ++k) {
      const Eigen::Vector2d pixel(static_cast<double>(points.x[i]) + kPattern[k].x,
                                  static_cast<double>(points.y[i]) + kPattern[k].y);
      const Eigen::Vector3d p =
          alignment.T_cur_ref.unitQuaternion() * kCamera.unproject(pixel) +
          static_cast<double>(points.trial_inverse_depth[i]) * alignment.T_cur_ref.translation();
      const Eigen::Vector2f seen = kCamera.project(p).cast<float>();
      points.reference[i * kPatternSize + k] = interpolateIntensity(image, seen.x(), seen.y());
    }
  }
}

/// Inverse depths between 0.5 and 1.5.
inline void scatterDepths(PointLevel& points, std::uint64_t seed) {
  Random random(seed);
  for (float& depth : points.trial_inverse_depth) {
    depth = static_cast<float>(random.uniform(0.5, 1.5));
  }
  points.inverse_depth = points.trial_inverse_depth;
}

}  // namespace dsorb::init_coarse
