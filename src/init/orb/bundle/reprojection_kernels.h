// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/geometry/se3.h"
#include "dsorb/options/orb_mapping.h"

#include "base/lanes.h"

#include <array>
#include <cstddef>

/// The inner loops of the geometric adjustment: one lane a corner.
namespace dsorb::init_orb {

constexpr int kPoseSize = 6;
constexpr std::size_t kPoseTriangle = 21;  ///< entries on and above the diagonal of a pose's block

/// Length of an array of corners, filled up to whole lanes.
constexpr std::size_t wholeLanes(std::size_t count) {
  constexpr std::size_t kWidth = kDoubleLanes;
  return (count + kWidth - 1) / kWidth * kWidth;
}

/// Camera and pose of one frame.
struct SightingFrame {
  std::array<double, 9> R;  ///< rotation reference to frame, row-major
  std::array<double, 3> t;  ///< translation reference to frame [unit]
  double fx, fy, cx, cy;    ///< [px]
};
SightingFrame sightingFrame(const PinholeCamera& camera, const SE3& T_cam_ref);

/// Corners as one frame sees them: arrays of `count` numbers, a multiple of kDoubleLanes.
struct SightingRun {
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
  std::array<double, kPoseTriangle> hessian{};  ///< sum w J^T J, rows of the upper triangle
  std::array<double, kPoseSize> gradient{};     ///< sum w J^T e
  double cost = 0;                              ///< sum of the loss
  double weighted_square = 0;                   ///< sum w e^2
  double sightings = 0;                         ///< in front of the camera
  double within = 0;                            ///< of them, with an error up to the limit
  double behind = 0;                            ///< not in front

  PoseSums& operator+=(const PoseSums& other);
};

/// Symmetric matrix of the sums over one pose.
Matrix6d hessianOf(const PoseSums& sums);

/// What is asked for each corner of a run; null where depths are fixed.
struct DepthSums {
  double* coupling = nullptr;  ///< set: w J_pose^T J_depth, 6 rows
  std::size_t stride = 0;      ///< from row to row
  double* hessian = nullptr;   ///< added to: w J_depth^2
  double* gradient = nullptr;  ///< added to: w J_depth e
};

/// Linearizes projectHosted() over a left increment of the pose and the inverse depths.
/// @param sums added to
void linearizeSightings(const SightingFrame& frame,
                        const SightingRun& run,
                        const LossSetting& loss,
                        const DepthSums& depths,
                        PoseSums& sums);

/// Couplings of a run of corners with all poses.
struct CouplingRun {
  const double* coupling;  ///< one row an unknown of the poses
  std::size_t rows;        ///< a multiple of kPoseSize
  std::size_t stride;      ///< from row to row
  const double* inverse;   ///< 1 / h, 0 for corners left out
  const double* gradient;  ///< b
  std::size_t count;       ///< of corners, a multiple of kDoubleLanes
};

/// Adds the sum of c c^T / h to the lower triangle of `matrix` (row-major) and that of c b / h to
/// `vector`.
void eliminateCorners(const CouplingRun& run, double* matrix, double* vector);

/// Solution for the inverse depths: -(b + c^T step) / h.
void substituteBack(const CouplingRun& run, const double* step, double* depths);

}  // namespace dsorb::init_orb
