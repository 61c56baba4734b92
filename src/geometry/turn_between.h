// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Geometry>

#include <cmath>

namespace dsorb {

/// The smallest rotation of one direction into another; where they are opposite, about any axis
/// across. Eigen's FromTwoVectors has the same bits, and with it a source compiles a singular value
/// decomposition, for the opposite ones, in seven seconds.
inline Eigen::Quaterniond turnBetween(const Eigen::Vector3d& from, const Eigen::Vector3d& to) {
  constexpr double kOpposite = 1e-12;
  const Eigen::Vector3d a = from.normalized();
  const Eigen::Vector3d b = to.normalized();
  const double cosine = b.dot(a);
  Eigen::Quaterniond turn;
  if (cosine < -1.0 + kOpposite) {
    turn.vec() = a.unitOrthogonal();
    turn.w() = 0;
    return turn;
  }
  const double scale = std::sqrt((1.0 + cosine) * 2.0);
  turn.vec() = a.cross(b) * (1.0 / scale);
  turn.w() = scale * 0.5;
  return turn;
}

}  // namespace dsorb
