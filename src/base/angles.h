// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <cmath>

namespace dsorb {

constexpr double kDegPerRad = 180 / M_PI;
constexpr double kRadPerDeg = M_PI / 180;

/// Between two directions of any length, 0 to 180.
inline double angleDeg(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b)) * kDegPerRad;
}

}  // namespace dsorb
