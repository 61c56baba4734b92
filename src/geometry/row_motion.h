// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/geometry/se3.h"

#include <vector>

namespace dsorb {

/// Motion of a camera while its rows are read: at time t after the middle row its pose is
/// exp(t velocity + t^2 / 2 acceleration) T_cam_world, with [translation; rotation].
struct RowMotion {
  Vector6d velocity = Vector6d::Zero();      ///< [unit/s; rad/s]
  Vector6d acceleration = Vector6d::Zero();  ///< [unit/s^2; rad/s^2]

  /// Makes `factor` units of before one.
  void changeUnit(double factor) {
    velocity.head<3>() *= factor;
    acceleration.head<3>() *= factor;
  }
};

/// A pose and when the camera had it.
struct TimedPose {
  double time = 0;  ///< [s]
  SE3 T_cam_world;
};

/// Parabola through a pose and two neighbours; constant velocity with one, rest with none.
/// Neighbours at the very same time do not count.
/// @param neighbours the nearest first, of which two count
RowMotion motionThrough(const TimedPose& pose, const std::vector<TimedPose>& neighbours);

/// Motion at each of some poses, in the order of time, by the two nearest others.
std::vector<RowMotion> motionsAlong(const std::vector<TimedPose>& poses);

}  // namespace dsorb
