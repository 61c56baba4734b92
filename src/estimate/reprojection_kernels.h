// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/geometry/se3.h"
#include "dsorb/options/orb_mapping.h"

#include "base/lanes.h"
#include "estimate/linear_system.h"
#include "estimate/warp.h"

#include <cstddef>

/// The inner loops of the geometric adjustment: one lane a corner.
namespace dsorb {

constexpr int kPoseSize = 6;

/// Length of an array of corners, filled up to whole lanes.
constexpr std::size_t wholeLanes(std::size_t count) {
  constexpr std::size_t kStep = kDoubleLanes;
  return (count + kStep - 1) / kStep * kStep;
}

/// Corners as one frame sees them: arrays of `count` numbers, a multiple of kDoubleLanes.
struct ObservationRun {
  const double* ray_x;  ///< of the corner in the reference, at z = 1
  const double* ray_y;
  const double* inverse_depth;  ///< [1/unit]
  const double* pixel_x;        ///< where the frame sees it [px]
  const double* pixel_y;
  const double* information_xx;  ///< inverse covariance of that [1/px^2]; 0: the frame does not
  const double* information_xy;
  const double* information_yy;
  std::size_t count;
};

/// Loss of the whitened error e: Huber's, or Cauchy's limit^2 / 2 log(1 + e^2 / limit^2).
struct LossSetting {
  RobustLoss loss;
  double limit;
};

/// Sums over all corners of a run.
struct PoseSums {
  Matrix6d hessian = Matrix6d::Zero();   ///< sum w J^T J
  Vector6d gradient = Vector6d::Zero();  ///< sum w J^T e
  double cost = 0;                       ///< sum of the loss
  double weighted_square = 0;            ///< sum w e^2
  double observations = 0;               ///< in front of the camera
  double within = 0;                     ///< of them, with an error up to the limit
  double behind = 0;                     ///< not in front

  PoseSums& operator+=(const PoseSums& other);
};

/// Linearizes the projection over a left increment of the pose and the inverse depths.
/// @param depths null where the inverse depths are fixed; couplings are set
/// @param sums   added to
void linearizeObservations(const Warp<double>& frame,
                           const ObservationRun& run,
                           const LossSetting& loss,
                           const PointSums<double>& depths,
                           PoseSums& sums);

}  // namespace dsorb
