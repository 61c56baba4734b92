// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/geometry/se3.h"

#include "geometry/row_motion.h"

#include <vector>

namespace dsorb::track {

/// What is known of the motion while the rows of a frame are read: the parabola through its pose
/// and two before it, and by how much that misses the velocity.
struct RowsOfFrame {
  double timestamp = 0;               ///< [s]
  std::vector<TimedPose> recent;      ///< T_cur_ref of frames before, the nearest first
  Vector6d sigma = Vector6d::Zero();  ///< standard deviation [unit/s; rad/s]

  [[nodiscard]] RowMotion predict(const SE3& T_cur_ref) const {
    return motionThrough({timestamp, T_cur_ref}, recent);
  }
};

/// The term of an alignment's energy that holds the velocity at what the frames before let expect,
/// to first order in the pose.
/// @source Schubert et al., Direct Sparse Odometry with Rolling Shutter, ECCV 2018: velocities are
///         unknowns with a prior; ours is the parabola
class VelocityTerm {
 public:
  /// @param variance of a point, of which its energy is the square [grey levels^2]
  VelocityTerm(const RowsOfFrame& rows, double variance);

  [[nodiscard]] double energy(const SE3& T_cur_ref, const Vector6d& velocity) const;
  /// Adds it to equations whose unknowns begin with the pose and end with the velocity.
  template <typename Matrix, typename Vector>
  void addTo(const SE3& T_cur_ref, const Vector6d& velocity, Matrix& H, Vector& b) const {
    const Vector6d gradient = information_.cwiseProduct(error(T_cur_ref, velocity));
    H.diagonal().template head<6>() += by_pose_ * by_pose_ * information_;
    H.diagonal().template tail<6>() += information_;
    H.template topRightCorner<6, 6>().diagonal() += by_pose_ * information_;
    H.template bottomLeftCorner<6, 6>().diagonal() += by_pose_ * information_;
    b.template head<6>() += by_pose_ * gradient;
    b.template tail<6>() += gradient;
  }

 private:
  [[nodiscard]] Vector6d error(const SE3& T_cur_ref, const Vector6d& velocity) const {
    return velocity - rows_.predict(T_cur_ref).velocity;
  }

  const RowsOfFrame& rows_;
  Vector6d information_;
  double by_pose_ = 0;  // derivative of the error by a left increment of the pose [1/s]
};

}  // namespace dsorb::track
