// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/geometry/se3.h"

namespace dsorb {
namespace {

constexpr double kSmallAngle = 1e-4;  // [rad]; the Taylor terms left out are below 1e-16 here

/// Left Jacobian V of SO(3): translation of exp([v; w]) is V v. @source Eade, Lie Groups for 2D and
/// 3D Transformations, section 3, exponential map of SE(3)
Eigen::Matrix3d leftJacobian(const Eigen::Vector3d& omega) {
  const double theta2 = omega.squaredNorm();
  const double theta = std::sqrt(theta2);
  double b = 0.5 - theta2 / 24.0;
  double c = 1.0 / 6.0 - theta2 / 120.0;
  if (theta > kSmallAngle) {
    b = (1.0 - std::cos(theta)) / theta2;
    c = (theta - std::sin(theta)) / (theta2 * theta);
  }
  const Eigen::Matrix3d W = hat(omega);
  return Eigen::Matrix3d::Identity() + b * W + c * W * W;
}

}  // namespace

Eigen::Quaterniond so3Exp(const Eigen::Vector3d& omega) {
  const double theta2 = omega.squaredNorm();
  const double theta = std::sqrt(theta2);
  const double half_sinc =
      theta > kSmallAngle ? std::sin(0.5 * theta) / theta : 0.5 - theta2 / 48.0;
  Eigen::Quaterniond q;
  q.w() = std::cos(0.5 * theta);
  q.vec() = half_sinc * omega;
  return q.normalized();
}

Eigen::Vector3d so3Log(const Eigen::Quaterniond& rotation) {
  const Eigen::Quaterniond q = rotation.w() < 0 ? Eigen::Quaterniond(-rotation.coeffs()) : rotation;
  const double n = q.vec().norm();
  const double scale = n > kSmallAngle ? 2.0 * std::atan2(n, q.w()) / n
                                       : 2.0 / q.w() - 2.0 / 3.0 * n * n / (q.w() * q.w() * q.w());
  return scale * q.vec();
}

SE3 SE3::exp(const Vector6d& xi) {
  return {so3Exp(xi.tail<3>()), leftJacobian(xi.tail<3>()) * xi.head<3>()};
}

Vector6d SE3::log() const {
  Vector6d xi;
  xi.tail<3>() = so3Log(rotation_);
  xi.head<3>() = leftJacobian(xi.tail<3>()).inverse() * translation_;
  return xi;
}

Eigen::Matrix4d SE3::matrix() const {
  Eigen::Matrix4d T = Eigen::Matrix4d::Identity();
  T.topLeftCorner<3, 3>() = rotationMatrix();
  T.topRightCorner<3, 1>() = translation_;
  return T;
}

Matrix6d SE3::adjoint() const {
  const Eigen::Matrix3d R = rotationMatrix();
  Matrix6d adjoint = Matrix6d::Zero();
  adjoint.topLeftCorner<3, 3>() = R;
  adjoint.topRightCorner<3, 3>() = hat(translation_) * R;
  adjoint.bottomRightCorner<3, 3>() = R;
  return adjoint;
}

}  // namespace dsorb
