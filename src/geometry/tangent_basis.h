// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Geometry>

namespace dsorb {

/// Orthonormal basis of the plane across a unit vector.
inline Eigen::Matrix<double, 3, 2> tangentBasis(const Eigen::Vector3d& unit) {
  Eigen::Matrix<double, 3, 2> basis;
  basis.col(0) = unit.unitOrthogonal();
  basis.col(1) = unit.cross(basis.col(0));
  return basis;
}

}  // namespace dsorb
