// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/geometry/se3.h"

#include <gmock/gmock.h>

#include <cmath>

namespace dsorb {

inline double rotationErrorDeg(const SE3& a, const SE3& b) {
  return so3Log((a.inverse() * b).unitQuaternion()).norm() * 180.0 / M_PI;
}

/// Angle between two directions [deg].
inline double directionErrorDeg(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b)) * 180.0 / M_PI;
}

/// Pose near another: rotation [deg], translation [unit]; says by how much it failed.
MATCHER_P3(Se3Near, expected, max_rotation_deg, max_translation, "") {
  const double rotation = rotationErrorDeg(arg, expected);
  const double translation = (arg.translation() - expected.translation()).norm();
  *result_listener << "rotation differs by " << rotation << " deg, translation by " << translation;
  return rotation <= max_rotation_deg && translation <= max_translation;
}

}  // namespace dsorb
