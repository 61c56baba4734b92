// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/options/orb_mapping.h"

#include "init/orb/initial_map.h"

#include <Eigen/Core>

#include <optional>
#include <vector>

namespace dsorb::init_orb {

constexpr int kPoseSize = 6;

/// Where the unknowns of the posed frames stand in the equations.
struct PoseRows {
  explicit PoseRows(const InitialMap& map);

  std::vector<int> first;  ///< one a frame; -1 for the reference and unposed frames
  int size = 0;            ///< of all poses together
};

/// Robustly weighted normal equations of the reprojection errors over poses (left increments) and
/// inverse depths: [pose_hessian, coupling; coupling^T, diag(depth_hessian)].
struct ReprojectionEquations {
  Eigen::MatrixXd pose_hessian;    ///< block diagonal
  Eigen::MatrixXd coupling;        ///< column i: corner i
  Eigen::VectorXd depth_hessian;   ///< 0 for corners left out
  Eigen::VectorXd pose_gradient;   ///< sum w J^T e
  Eigen::VectorXd depth_gradient;  ///<
  double weighted_error = 0;       ///< sum of w e^2 [-]
  int rows = 0;                    ///< scalar observations
};

/// @param kept one a corner; empty: all
ReprojectionEquations linearize(const InitialMap& map,
                                const std::vector<char>& kept,
                                const PoseRows& pose_rows,
                                const PinholeCamera& camera,
                                const GeometricOptions& options);

/// Robust loss of one observation, as Ceres counts it. @param error whitened, at least 0
double robustCost(double error, const GeometricOptions& options);

/// Half the sum of the robust loss, as Ceres counts it; nullopt when a point is behind a camera.
std::optional<double> reprojectionCost(const InitialMap& map,
                                       const std::vector<char>& kept,
                                       const PinholeCamera& camera,
                                       const GeometricOptions& options);

}  // namespace dsorb::init_orb
