// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/cxx17.h"

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <cmath>

namespace dsorb {

// Public types hold no aligned Eigen types: their layout does not depend on the instruction set
// that a program is compiled for.
/// Tangent of SE3: [translation; rotation].
using Vector6d = Eigen::Matrix<double, 6, 1, Eigen::DontAlign>;
/// Covariance or adjoint of SE3's tangent.
using Matrix6d = Eigen::Matrix<double, 6, 6, Eigen::DontAlign>;
/// Rotation of unit norm.
using UnitQuaternion = Eigen::Quaternion<double, Eigen::DontAlign>;

/// Skew-symmetric matrix [v]x with [v]x w = v x w.
inline Eigen::Matrix3d hat(const Eigen::Vector3d& v) {
  Eigen::Matrix3d m;
  m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return m;
}

/// Rigid transform. `T_a_b` maps coordinates of b to a: p_a = T_a_b * p_b. The tangent is
/// [translation; rotation]; updates multiply from the left: exp(xi) * T.
/// @source Eade, Lie Groups for 2D and 3D Transformations, sections 2 and 3
class SE3 {
 public:
  /// Identity.
  SE3() = default;
  /// @param rotation is normalized
  SE3(const Eigen::Quaterniond& rotation, const Eigen::Vector3d& translation)
      : rotation_(rotation.normalized()), translation_(translation) {}
  /// @param rotation orthonormal, determinant 1
  SE3(const Eigen::Matrix3d& rotation, const Eigen::Vector3d& translation)
      : SE3(Eigen::Quaterniond(rotation), translation) {}

  /// @param T [R t; 0 1]; its last row is not looked at
  static SE3 fromMatrix(const Eigen::Matrix4d& T) {
    return {Eigen::Matrix3d(T.topLeftCorner<3, 3>()), Eigen::Vector3d(T.topRightCorner<3, 1>())};
  }

  /// @param xi [translation; rotation], rotation in rad
  static SE3 exp(const Vector6d& xi);
  /// @return [translation; rotation], rotation angle in [0, pi]
  [[nodiscard]] Vector6d log() const;

  /// Rotation R of [R t; 0 1].
  [[nodiscard]] const UnitQuaternion& unitQuaternion() const { return rotation_; }
  /// Translation t of [R t; 0 1].
  [[nodiscard]] const Eigen::Vector3d& translation() const { return translation_; }
  /// R as a matrix.
  [[nodiscard]] Eigen::Matrix3d rotationMatrix() const { return rotation_.toRotationMatrix(); }
  /// [R t; 0 1].
  [[nodiscard]] Eigen::Matrix4d matrix() const;

  /// Leaves the rotation as it is.
  void setTranslation(const Eigen::Vector3d& translation) { translation_ = translation; }

  /// T_b_a of T_a_b.
  [[nodiscard]] SE3 inverse() const {
    const Eigen::Quaterniond inverse_rotation = rotation_.conjugate();
    return {inverse_rotation, -(inverse_rotation * translation_)};
  }
  /// T_a_b * T_b_c = T_a_c.
  [[nodiscard]] SE3 operator*(const SE3& other) const {
    return {rotation_ * other.rotation_, rotation_ * other.translation_ + translation_};
  }
  /// T_a_b * p_b = p_a.
  [[nodiscard]] Eigen::Vector3d operator*(const Eigen::Vector3d& point) const {
    return rotation_ * point + translation_;
  }

  /// 6x6 matrix with T exp(xi) T^-1 = exp(adjoint xi); blocks [R, [t]x R; 0, R].
  [[nodiscard]] Matrix6d adjoint() const;

 private:
  UnitQuaternion rotation_ = UnitQuaternion::Identity();
  Eigen::Vector3d translation_ = Eigen::Vector3d::Zero();
};

/// Unit quaternion of a rotation vector [rad].
Eigen::Quaterniond so3Exp(const Eigen::Vector3d& omega);
/// Rotation vector [rad] of a unit quaternion, angle in [0, pi].
Eigen::Vector3d so3Log(const Eigen::Quaterniond& rotation);

}  // namespace dsorb
