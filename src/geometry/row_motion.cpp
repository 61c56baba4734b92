// SPDX-License-Identifier: BSD-3-Clause
#include "geometry/row_motion.h"

#include <cstddef>

namespace dsorb {

RowMotion motionThrough(const TimedPose& pose, const std::vector<TimedPose>& neighbours) {
  RowMotion motion;
  const SE3 T_world_cam = pose.T_cam_world.inverse();
  double first_time = 0;
  Vector6d first;
  for (const TimedPose& neighbour : neighbours) {
    const double time = neighbour.time - pose.time;
    if (time == 0 || time == first_time) continue;
    const Vector6d moved = (neighbour.T_cam_world * T_world_cam).log();
    if (first_time == 0) {
      first_time = time;
      first = moved;
      motion.velocity = moved / time;
      continue;
    }
    // moved = time velocity + time^2 / 2 acceleration, for both.
    const Vector6d second = moved / time;
    motion.acceleration = 2 * (second - motion.velocity) / (time - first_time);
    motion.velocity -= 0.5 * first_time * motion.acceleration;
    break;
  }
  return motion;
}

std::vector<RowMotion> motionsAlong(const std::vector<TimedPose>& poses) {
  std::vector<RowMotion> motions;
  const std::size_t count = poses.size();
  for (std::size_t k = 0; k < count; ++k) {
    std::vector<TimedPose> neighbours;
    for (const std::size_t other : {k - 1, k + 1, k - 2, k + 2}) {  // wraps below 0
      if (other < count) neighbours.push_back(poses[other]);
    }
    motions.push_back(motionThrough(poses[k], neighbours));
  }
  return motions;
}

}  // namespace dsorb
