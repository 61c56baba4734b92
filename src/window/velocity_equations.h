// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "estimate/linear_system.h"
#include "window/pair_equations.h"
#include "window/pair_geometry.h"
#include "window/photometric_residual.h"

#include <Eigen/Core>

#include <cstddef>

/// The part of a window's normal equations that belongs to the velocities of rolling shutters. A
/// residual depends on the velocity of its target (host) as on its pose, times the time of the row
/// that sees (hosts) the point: products of derivatives by the relative pose, weighted with times,
/// are all that it takes.
namespace dsorb::window {

/// Sums of one ordered pair. Lanes of a row as in photometric_residual.h; times as RowTimesOfPoint.
struct VelocitySums {
  alignas(64) double by_target[kPoseRows][kRowLanes];  // times that of the target's row
  double by_host[kPoseRows][kRowLanes];
  double target_target[kPoseRows][kPoseLanes];  // times its square, and so on
  double target_host[kPoseRows][kPoseLanes];
  double host_host[kPoseRows][kPoseLanes];
};

/// Adds one residual.
/// @param x, y the patch block times geometry, brightness, residual: kRowLanes of them
DSORB_ALWAYS_INLINE void accumulateVelocities(const ResidualGeometry& g,
                                              const float* x,
                                              const float* y,
                                              VelocitySums& sums) {
  const auto target = static_cast<double>(g.target_time);
  const auto host = static_cast<double>(g.host_time);
  for (std::size_t row = 0; row < kPoseRows; ++row) {
    const auto jx = static_cast<double>(g.x[row]);
    const auto jy = static_cast<double>(g.y[row]);
    double both[kRowLanes];
    for (std::size_t i = 0; i < kRowLanes; ++i) {
      both[i] = jx * static_cast<double>(x[i]) + jy * static_cast<double>(y[i]);
    }
    for (std::size_t i = 0; i < kRowLanes; ++i) {
      sums.by_target[row][i] += target * both[i];
      sums.by_host[row][i] += host * both[i];
    }
    for (std::size_t i = 0; i < kPoseLanes; ++i) {
      sums.target_target[row][i] += target * target * both[i];
      sums.target_host[row][i] += target * host * both[i];
      sums.host_host[row][i] += host * host * both[i];
    }
  }
}

/// Adds the sums of other points.
inline void add(const VelocitySums& other, VelocitySums& sums) {
  constexpr std::size_t kCount = sizeof(VelocitySums) / sizeof(double);
  const double* from = other.by_target[0];
  double* to = sums.by_target[0];
  for (std::size_t i = 0; i < kCount; ++i) to[i] += from[i];
}

/// Adds one pair to the system of absolute states.
void addVelocities(const VelocitySums& sums,
                   const PairGeometry& pair,
                   const PairRows& rows,
                   LinearSystem<float>& out);

}  // namespace dsorb::window
