// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/thesis/ceres/reprojection_cost.h"

#include "estimate/warp.h"

namespace dsorb::init_orb {
namespace {

using RowMajor2x7 = Eigen::Matrix<double, 2, 7, Eigen::RowMajor>;
using RowMajor6x7 = Eigen::Matrix<double, 6, 7, Eigen::RowMajor>;
using RowMajor7x6 = Eigen::Matrix<double, 7, 6, Eigen::RowMajor>;

RowMajor6x7 minusJacobian(const double* x) {
  const Eigen::Vector3d v(x[0], x[1], x[2]);
  const Eigen::Vector3d t(x[4], x[5], x[6]);
  RowMajor6x7 J = RowMajor6x7::Zero();
  J.block<3, 3>(3, 0) = 2.0 * (x[3] * Eigen::Matrix3d::Identity() + hat(v));
  J.block<3, 1>(3, 3) = -2.0 * v;
  J.block<3, 4>(0, 0) = hat(t) * J.block<3, 4>(3, 0);
  J.block<3, 3>(0, 4).setIdentity();
  return J;
}

}  // namespace

PoseBlock toBlock(const SE3& pose) {
  const Eigen::Quaterniond& q = pose.unitQuaternion();
  const Eigen::Vector3d& t = pose.translation();
  return {q.x(), q.y(), q.z(), q.w(), t.x(), t.y(), t.z()};
}

SE3 fromBlock(const double* block) {
  return {Eigen::Quaterniond(block[3], block[0], block[1], block[2]),
          Eigen::Vector3d(block[4], block[5], block[6])};
}

bool PoseManifold::Plus(const double* x, const double* delta, double* x_plus_delta) const {
  const SE3 moved = SE3::exp(Eigen::Map<const Vector6d>(delta)) * fromBlock(x);
  const PoseBlock block = toBlock(moved);
  std::copy(block.begin(), block.end(), x_plus_delta);
  return true;
}

bool PoseManifold::PlusJacobian(const double* x, double* jacobian) const {
  const Eigen::Vector3d v(x[0], x[1], x[2]);
  const Eigen::Vector3d t(x[4], x[5], x[6]);
  Eigen::Map<RowMajor7x6> J(jacobian);
  J.setZero();
  J.block<3, 3>(0, 3) = 0.5 * (x[3] * Eigen::Matrix3d::Identity() - hat(v));
  J.block<1, 3>(3, 3) = -0.5 * v.transpose();
  J.block<3, 3>(4, 0).setIdentity();
  J.block<3, 3>(4, 3) = -hat(t);
  return true;
}

bool PoseManifold::Minus(const double* y, const double* x, double* y_minus_x) const {
  Eigen::Map<Vector6d>(y_minus_x, 6) = (fromBlock(y) * fromBlock(x).inverse()).log();
  return true;
}

bool PoseManifold::MinusJacobian(const double* x, double* jacobian) const {
  Eigen::Map<RowMajor6x7>(jacobian, 6, 7) = minusJacobian(x);
  return true;
}

bool ReprojectionCost::Evaluate(double const* const* parameters,
                                double* residuals,
                                double** jacobians) const {
  const std::optional<HostedProjection> projection =
      projectHosted(*camera_, fromBlock(parameters[0]), ray_, parameters[1][0]);
  if (!projection) {
    return false;
  }
  Eigen::Map<Eigen::Vector2d>(residuals, 2) = whitening_ * (projection->pixel - pixel_);
  if (jacobians == nullptr) {
    return true;
  }
  if (jacobians[0] != nullptr) {
    Eigen::Map<RowMajor2x7>(jacobians[0], 2, 7).noalias() =
        whitening_ * projection->J_pose * minusJacobian(parameters[0]);
  }
  if (jacobians[1] != nullptr) {
    Eigen::Map<Eigen::Vector2d>(jacobians[1], 2) = whitening_ * projection->J_inverse_depth;
  }
  return true;
}

}  // namespace dsorb::init_orb
