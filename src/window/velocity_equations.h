// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "base/lanes.h"
#include "estimate/linear_system.h"
#include "window/pair_equations.h"
#include "window/pair_geometry.h"
#include "window/photometric_residual.h"

#include <cstddef>

/// The part of a window's normal equations that belongs to the velocities of rolling shutters. A
/// residual depends on the velocity of its target (host) as on its pose, times the time of the row
/// that sees (hosts) the point: products of derivatives by the relative pose, weighted with times,
/// are all that it takes.
namespace dsorb::window {

/// Sums over a chunk of points for one ordered pair. Lanes of a row as in photometric_residual.h;
/// times as in ResidualGeometry. Single precision is enough: priors hold the velocities.
struct VelocitySums {
  alignas(32) float by_target[kPoseRows][kRowLanes];  // times that of the target's row
  float by_host[kPoseRows][kRowLanes];
  float target_residual[kPoseLanes];  // column of the residual
  float host_residual[kPoseLanes];
  float target_target[kPoseRows][kPoseLanes];  // times its square, and so on
  float target_host[kPoseRows][kPoseLanes];
  float host_host[kPoseRows][kPoseLanes];
};

/// Adds one residual.
/// @param x, y   the patch block times geometry, brightness, residual: kRowLanes of them
/// @param camera whether there is more in them than pose, brightness and residual
DSORB_ALWAYS_INLINE void accumulateVelocities(
    const ResidualGeometry& g, const float* x, const float* y, bool camera, VelocitySums& sums) {
  static_assert(kPoseLanes == kLanes && kRowLanes - kPoseLanes == kLanes);
  Lanes pose_x;
  Lanes pose_y;
  load(x, pose_x);
  load(y, pose_y);
  for (std::size_t row = 0; row < kPoseRows; ++row) {
    const Lanes pose = g.x[row] * pose_x + g.y[row] * pose_y;
    const Lanes by_target = g.target_time * pose;
    const Lanes by_host = g.host_time * pose;
    addLanes(by_target, sums.by_target[row]);
    addLanes(by_host, sums.by_host[row]);
    addLanes(g.target_time * by_target, sums.target_target[row]);
    addLanes(g.target_time * by_host, sums.target_host[row]);
    addLanes(g.host_time * by_host, sums.host_host[row]);
  }
  Lanes residual;
  residualColumn(g, x, y, residual);
  addLanes(g.target_time * residual, sums.target_residual);
  addLanes(g.host_time * residual, sums.host_residual);
  if (!camera) return;
  Lanes rest_x;
  Lanes rest_y;
  load(x + kLanes, rest_x);
  load(y + kLanes, rest_y);
  for (std::size_t row = 0; row < kPoseRows; ++row) {
    const Lanes rest = g.x[row] * rest_x + g.y[row] * rest_y;
    addLanes(g.target_time * rest, sums.by_target[row] + kLanes);
    addLanes(g.host_time * rest, sums.by_host[row] + kLanes);
  }
}

/// Adds the sums of other points.
inline void add(const VelocitySums& other, VelocitySums& sums) {
  constexpr std::size_t kCount = sizeof(VelocitySums) / sizeof(float);
  const float* from = other.by_target[0];
  float* to = sums.by_target[0];
  for (std::size_t i = 0; i < kCount; ++i) to[i] += from[i];
}

/// Adds one pair to the system of absolute states.
void addVelocities(const VelocitySums& sums,
                   const PairGeometry& pair,
                   const PairRows& rows,
                   LinearSystem<float>& out);

}  // namespace dsorb::window
