// SPDX-License-Identifier: BSD-3-Clause
#include "track/velocity_term.h"

namespace dsorb::track {

VelocityTerm::VelocityTerm(const RowsOfFrame& rows, double variance)
    : rows_(rows), information_(variance * rows.sigma.cwiseAbs2().cwiseInverse()) {
  // The parabola through 0, -x at t1 and -x at t2 has the velocity -x (1 / t1 + 1 / t2).
  double nearest = 0;
  for (const TimedPose& pose : rows.recent) {
    const double time = pose.time - rows.timestamp;
    if (time == 0 || time == nearest) continue;
    by_pose_ += 1 / time;
    if (nearest != 0) break;
    nearest = time;
  }
}

double VelocityTerm::energy(const SE3& T_cur_ref, const Vector6d& velocity) const {
  return error(T_cur_ref, velocity).cwiseAbs2().dot(information_);
}

}  // namespace dsorb::track
