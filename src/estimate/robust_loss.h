// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "base/lanes.h"

#include <cmath>

/// Robust losses rho(r) and their weights w = rho'(r) / (2 r), for iteratively re-weighted least
/// squares. All are r^2 near zero; Ceres counts half of each.
namespace dsorb {

constexpr float kHuberThreshold = 9.0F;  // [grey levels]; DSO, section 2.2

/// Huber's weight: 1 up to the threshold, threshold / |r| above; 1 for NaN.
template <typename Scalar>
inline Scalar huberWeight(Scalar residual, Scalar threshold) {
  const Scalar magnitude = std::abs(residual);
  return magnitude > threshold ? threshold / magnitude : Scalar(1);  // no division for most
}
inline float huberWeight(float residual) {
  return huberWeight(residual, kHuberThreshold);
}

/// The same in lanes of T = Lanes or DoubleLanes.
/// @param magnitude |r|
/// @param threshold the same in all lanes
template <typename T>
DSORB_ALWAYS_INLINE T huberWeights(const T& magnitude, const T& threshold) {
  return threshold / (magnitude > threshold ? magnitude : threshold);
}

/// Huber weights of residuals in grey levels.
DSORB_ALWAYS_INLINE Lanes huberWeights(const Lanes& residual) {
  const Lanes magnitude = residual < 0.0F ? -residual : residual;
  return huberWeights(magnitude, spread<Lanes>(kHuberThreshold));
}

/// Huber's loss, r^2 up to the threshold, 2 threshold |r| - threshold^2 above, by its weight w:
/// w r^2 (2 - w), in lanes or alone.
/// @param huber  w
/// @param weight w times what the residual counts beside it
template <typename T>
DSORB_ALWAYS_INLINE T huberEnergies(const T& residual, const T& huber, const T& weight) {
  return weight * residual * residual * (2.0F - huber);
}
/// Huber energies of residuals whose other weight is 1.
template <typename T>
DSORB_ALWAYS_INLINE T huberEnergies(const T& residual, const T& huber) {
  return huberEnergies(residual, huber, huber);
}

constexpr double kCauchyLimit = 2.385;  // of normalised errors: 95 % efficient where normal

/// Cauchy's loss is limit^2 log(ratio) with ratio = 1 + r^2 / limit^2; its weight is 1 / ratio.
/// @param squared r^2, in lanes or alone
template <typename T>
DSORB_ALWAYS_INLINE T cauchyRatio(const T& squared, double limit) {
  return 1.0 + squared * (1 / (limit * limit));
}

}  // namespace dsorb
