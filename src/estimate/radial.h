// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "base/lanes.h"

#include <Eigen/Core>

/// Radial distortion that a calibration lacks, on the plane z = 1: seen = ideal (1 + k r^2), r the
/// length of the ideal ray.
/// @source first term of Brown, Close-Range Camera Calibration, 1971; LensModel::kRadTan's k1
namespace dsorb {

/// Moves (u, v) from where a pinhole camera would see a ray to where the lens shows it.
/// @tparam T float or Lanes
template <typename T>
DSORB_ALWAYS_INLINE void bend(float k, T& u, T& v) {
  const T factor = 1.0F + k * (u * u + v * v);
  u *= factor;
  v *= factor;
}

/// Back, by iteration.
inline Eigen::Vector2f unbend(float k, const Eigen::Vector2f& seen) {
  constexpr int kIterations = 8;  // each multiplies the error by about 2 k r^2
  Eigen::Vector2f ideal = seen;
  for (int i = 0; k != 0 && i < kIterations; ++i) ideal = seen / (1.0F + k * ideal.squaredNorm());
  return ideal;
}

/// A small shift of what is seen as one of the ideal ray: the inverse derivative of bend().
inline Eigen::Vector2f unbendShift(float k,
                                   const Eigen::Vector2f& ideal,
                                   const Eigen::Vector2f& shift) {
  const float squared = k * ideal.squaredNorm();
  return (shift - ideal * (2.0F * k * ideal.dot(shift) / (1.0F + 3.0F * squared))) /
         (1.0F + squared);
}

/// An image gradient [1/px] by where the lens shows a ray as one by where a pinhole camera would:
/// the transposed derivative of bend().
/// @param ratio fy over fx
template <typename T>
DSORB_ALWAYS_INLINE void bendGradient(float k, const T (&ray)[2], float ratio, T& dx, T& dy) {
  const T& u = ray[0];
  const T& v = ray[1];
  const T factor = 1.0F + k * (u * u + v * v);
  const T along = 2.0F * k * (u * dx + v * ratio * dy);
  dx = factor * dx + along * u;
  dy = factor * dy + along * v / ratio;
}

}  // namespace dsorb
