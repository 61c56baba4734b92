// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "init/orb/map/initial_map.h"
#include "init/orb/photometric/photometric_problem.h"

#include <Eigen/Core>

#include <vector>

namespace dsorb::init_orb {

/// The corners' poses and photometric ones, weighted by their covariances: a Kalman update of the
/// joint frames by those that the images were compared in; the others follow by what the joint
/// covariance says of them. That covariance stays valid, and is not reduced: both estimates were
/// made of the same images.
struct CombinedPoses {
  std::vector<SE3> T_cam_ref;  ///< by joint frame
  double distance = 0;         ///< Mahalanobis distance of the two, a degree of freedom [-]
};

/// @param map         adjusted geometrically; the problem's frames are joint frames of it
/// @param photometric poses of the problem's frames, in the map's unit
/// @param covariance  of their left increments, 6 rows each
/// @source Kalman, A New Approach to Linear Filtering and Prediction Problems, 1960
CombinedPoses combinePoses(const InitialMap& map,
                           const PhotometricProblem& problem,
                           const std::vector<SE3>& photometric,
                           const Eigen::MatrixXd& covariance);

}  // namespace dsorb::init_orb
