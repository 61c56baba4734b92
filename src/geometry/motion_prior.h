// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "geometry/row_motion.h"

namespace dsorb {

/// What the frames around one say of its motion while its rows are read.
struct MotionPrior {
  RowMotion mean;
  Vector6d sigma = Vector6d::Zero();  ///< standard deviation of the velocity [unit/s; rad/s]
};

}  // namespace dsorb
