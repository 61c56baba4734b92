// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/geometry/se3.h"

#include <Eigen/Core>

#include <cmath>

namespace dsorb {

/// Tangent of Similarity: [translation; rotation; logarithm of the scale].
using Vector7d = Eigen::Matrix<double, 7, 1, Eigen::DontAlign>;
/// Covariance of it.
using Matrix7d = Eigen::Matrix<double, 7, 7, Eigen::DontAlign>;

/// Motion with a change of the unit: `S_a_b` maps coordinates of b to a, p_a = scale R p_b + t.
struct Similarity {
  SE3 motion;        ///< R and t
  double scale = 1;  ///< length of b's unit in a's

  /// S_a_b * p_b = p_a.
  [[nodiscard]] Eigen::Vector3d operator*(const Eigen::Vector3d& point) const {
    return scale * (motion.unitQuaternion() * point) + motion.translation();
  }
  /// S_a_b * S_b_c = S_a_c.
  [[nodiscard]] Similarity operator*(const Similarity& other) const {
    const Eigen::Quaterniond rotation = motion.unitQuaternion() * other.motion.unitQuaternion();
    return {SE3(rotation, *this * other.motion.translation()), scale * other.scale};
  }
  /// S_b_a of S_a_b.
  [[nodiscard]] Similarity inverse() const {
    const Eigen::Quaterniond back = motion.unitQuaternion().conjugate();
    return {SE3(back, -(back * motion.translation()) / scale), 1 / scale};
  }
  /// Pose of a camera in a, whose pose in b is T_b_cam; its axes keep their length.
  [[nodiscard]] SE3 moved(const SE3& T_b_cam) const {
    return {motion.unitQuaternion() * T_b_cam.unitQuaternion(), *this * T_b_cam.translation()};
  }
  /// S increment(xi) S^-1 = increment(adjoint xi), to first order.
  [[nodiscard]] Matrix7d adjoint() const {
    const Eigen::Matrix3d R = motion.rotationMatrix();
    Matrix7d adjoint = Matrix7d::Identity();
    adjoint.topLeftCorner<3, 3>() = scale * R;
    adjoint.block<3, 3>(0, 3) = hat(motion.translation()) * R;
    adjoint.topRightCorner<3, 1>() = -motion.translation();
    adjoint.block<3, 3>(3, 3) = R;
    return adjoint;
  }
  /// The similarity of a small left increment: translation, rotation [rad], log of the scale.
  static Similarity increment(const Vector7d& xi) {
    return {SE3(so3Exp(xi.segment<3>(3)), Eigen::Vector3d(xi.head<3>())), std::exp(xi[6])};
  }
};

}  // namespace dsorb
