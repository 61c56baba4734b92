// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/options/orb_mapping.h"

#include "init/orb/bundle/reprojection_equations.h"
#include "init/orb/map/initial_map.h"

#include <Eigen/Core>

#include <array>
#include <optional>
#include <vector>

/// Adjustment of a map whose rows were exposed at different times. Observations are kept at the
/// time of the middle row, where the map's motions have moved them; what these motions are wrong by
/// is unknown as well: an observation depends on the velocity of its frame as on its pose, times
/// the time of the row that sees it, and on that of the reference, times that of the hosting row.
/// @source Schubert et al., Direct Sparse Odometry with Rolling Shutter, ECCV 2018
namespace dsorb::init_orb {

/// Times of the rows that see the corners, relative to the middle rows [s].
struct RowTimesOfMap {
  std::vector<double> host;    ///< one a corner
  std::vector<double> target;  ///< one an observation

  RowTimesOfMap(const InitialMap& map, const PinholeCamera& camera);
};

/// How the pose between two rows depends on the left increments of a frame's pose, on its velocity
/// and acceleration, and on the reference's velocity and acceleration, the latter two seen from the
/// frame: one factor each.
constexpr int kFactors = 5;
using MotionFactors = Eigen::Matrix<double, kFactors, 1>;
/// @param target, host times of the rows [s]
inline MotionFactors motionFactors(double target, double host) {
  return {1, target, 0.5 * target * target, -host, -0.5 * host * host};
}

/// Rows of the unknowns: the poses as in PoseRows, velocity and acceleration of the same frames in
/// the same order, then those of the reference.
struct MotionRows {
  static constexpr int kMotionSize = 2 * kPoseSize;
  int of_poses;
  [[nodiscard]] int of(int pose_row) const { return of_poses + 2 * pose_row; }
  [[nodiscard]] int ofReference() const { return of(of_poses); }
  [[nodiscard]] int size() const { return ofReference() + kMotionSize; }
  /// Rows of the unknowns that the factors stand for.
  [[nodiscard]] std::array<int, kFactors> ofFactors(int pose_row) const {
    const int motion = of(pose_row);
    return {pose_row, motion, motion + kPoseSize, ofReference(), ofReference() + kPoseSize};
  }
};

/// Adds to a vector of all unknowns what a vector by the pose's increments means for them.
void addByFactors(const Vector6d& by_pose,
                  const MotionFactors& factors,
                  const Matrix6d& adjoint,
                  const std::array<int, kFactors>& rows,
                  Eigen::Ref<Eigen::VectorXd> all);

/// The motions' part of the direction in which all translations grow together.
void scaleMotions(const InitialMap& map, const PoseRows& pose_rows, Eigen::VectorXd& direction);

/// Normal equations over MotionRows and inverse depths, with the map's priors of the velocities.
ReprojectionEquations linearizeRolling(const InitialMap& map,
                                       const PoseRows& pose_rows,
                                       const PinholeCamera& camera,
                                       const GeometricOptions& options);

/// Moves poses, inverse depths and velocities to the minimum, and pixels to where the velocities
/// found would have them at the times of the middle rows.
/// @return iterations, or nullopt when no usable numbers were found
std::optional<int> solveRolling(InitialMap& map,
                                const PinholeCamera& camera,
                                const GeometricOptions& options,
                                const Stopping& stopping);

}  // namespace dsorb::init_orb
