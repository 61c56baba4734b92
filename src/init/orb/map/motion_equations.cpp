// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/map/motion_equations.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <cstddef>

namespace dsorb::init_orb {
namespace {

constexpr Eigen::Index kPoseSize = 6;

/// Estimate beside what is known.
struct Comparison {
  SE3 T_to_from;  // estimated
  Vector6d error = Vector6d::Zero();
};

std::vector<Comparison> compare(const std::vector<KnownMotion>& motions,
                                const std::vector<SE3>& T_cam_ref) {
  std::vector<Comparison> all;
  for (const KnownMotion& known : motions) {
    const SE3 from = known.from == KnownMotion::kReference ? SE3() : T_cam_ref[known.from];
    Comparison one{T_cam_ref[known.to] * from.inverse(), Vector6d::Zero()};
    one.error.tail<3>() =
        so3Log(one.T_to_from.unitQuaternion() * known.T_to_from.unitQuaternion().conjugate());
    all.push_back(one);
  }
  return all;
}

/// Metres of a unit with the least cost, at least 0, and its information; completes the errors.
double fitMetres(const std::vector<KnownMotion>& motions,
                 std::vector<Comparison>& all,
                 double& information) {
  double product = 0;
  information = 0;
  for (std::size_t i = 0; i < all.size(); ++i) {
    const Eigen::Matrix<double, 3, 6> of_translation = motions[i].information.topRows<3>();
    const Eigen::Vector3d t = all[i].T_to_from.translation();
    Vector6d rest = all[i].error;
    rest.head<3>() -= motions[i].T_to_from.translation();
    product -= t.dot(of_translation * rest);
    information += t.dot(of_translation.leftCols<3>() * t);
  }
  const double metres = information > 0 ? std::max(0., product / information) : 0;
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (!motions[i].has_translation) continue;
    all[i].error.head<3>() =
        metres * all[i].T_to_from.translation() - motions[i].T_to_from.translation();
  }
  return metres;
}

}  // namespace

MotionEquations motionEquations(const std::vector<KnownMotion>& motions,
                                const std::vector<SE3>& T_cam_ref) {
  const auto size = static_cast<Eigen::Index>(T_cam_ref.size()) * kPoseSize;
  MotionEquations made;
  made.H = Eigen::MatrixXd::Zero(size, size);
  made.b = Eigen::VectorXd::Zero(size);
  std::vector<Comparison> all = compare(motions, T_cam_ref);
  double information = 0;
  made.metres = fitMetres(motions, all, information);
  Eigen::VectorXd of_metres = Eigen::VectorXd::Zero(size);
  for (std::size_t i = 0; i < all.size(); ++i) {
    const KnownMotion& known = motions[i];
    const Eigen::Vector3d t = all[i].T_to_from.translation();
    const Eigen::Matrix3d R = all[i].T_to_from.rotationMatrix();
    Eigen::MatrixXd J = Eigen::MatrixXd::Zero(kPoseSize, size);
    const auto to = static_cast<Eigen::Index>(known.to) * kPoseSize;
    J.block<3, 3>(0, to) = made.metres * Eigen::Matrix3d::Identity();
    J.block<3, 3>(0, to + 3) = -made.metres * hat(t);
    J.block<3, 3>(3, to + 3).setIdentity();
    if (known.from != KnownMotion::kReference) {
      const auto from = static_cast<Eigen::Index>(known.from) * kPoseSize;
      J.block<3, 3>(0, from) = -made.metres * R;
      J.block<3, 3>(3, from + 3) = -R;
    }
    const Eigen::MatrixXd weighted = J.transpose() * known.information;
    made.H += weighted * J;
    made.b += weighted * all[i].error;
    of_metres += weighted.leftCols<3>() * t;
    made.cost += 0.5 * all[i].error.dot(known.information * all[i].error);
    made.rows += known.has_translation ? 6 : 3;
  }
  if (information > 0) --made.rows;
  if (made.metres > 0) made.H -= of_metres * of_metres.transpose() / information;
  return made;
}

}  // namespace dsorb::init_orb
