// SPDX-License-Identifier: BSD-3-Clause
#include "geometry/reattachment.h"

#include "geometry/turn_between.h"

namespace dsorb {

SE3 reattach(const SE3& T_cam_first, const CorrectedMotion& motion, double progress) {
  const Eigen::Vector3d then = motion.T_second_first_then.inverse().translation();
  const Eigen::Vector3d now = motion.T_second_first_now.inverse().translation();
  Eigen::Vector3d position = T_cam_first.inverse().translation();
  if (then.norm() > 0 && now.norm() > 0) {
    position = turnBetween(then, now) * position;
    position *= now.norm() / then.norm();
  }
  const SE3 turn(motion.T_second_first_now.unitQuaternion() *
                     motion.T_second_first_then.unitQuaternion().conjugate(),
                 Eigen::Vector3d::Zero());
  const Eigen::Quaterniond rotation =
      SE3::exp(progress * turn.log()).unitQuaternion() * T_cam_first.unitQuaternion();
  return {rotation, -(rotation * position)};
}

SE3 spreadCorrection(const SE3& T_cam_first, const CorrectedMotion& motion, double progress) {
  const SE3 correction = motion.T_second_first_now * motion.T_second_first_then.inverse();
  return SE3::exp(progress * correction.log()) * T_cam_first;
}

}  // namespace dsorb
