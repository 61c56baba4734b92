// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "geometry/row_motion.h"

namespace dsorb {

/// What the frames around one say of its motion while its rows are read.
struct MotionPrior {
  RowMotion mean;
  Vector6d sigma = Vector6d::Zero();  ///< standard deviation of the velocity [unit/s; rad/s]
  Vector6d acceleration_sigma = Vector6d::Zero();  ///< [unit/s^2; rad/s^2]

  /// Makes `factor` units of before one.
  void changeUnit(double factor) {
    mean.changeUnit(factor);
    sigma.head<3>() *= factor;
    acceleration_sigma.head<3>() *= factor;
  }
};

}  // namespace dsorb
