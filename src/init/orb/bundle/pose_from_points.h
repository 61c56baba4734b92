// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/geometry/se3.h"

#include "init/orb/bundle/reprojection_kernels.h"

#include <Eigen/Core>

#include <optional>
#include <vector>

namespace dsorb::init_orb {

constexpr double kTrackSigma = 1;  ///< of tracks, generous: the inverse depths may be rough [px]

/// A hosted point and where a camera saw it.
struct PointObservation {
  Eigen::Vector3d host_ray{0, 0, 1};  ///< z = 1
  double inverse_depth = 0;           ///< [1/unit]
  Eigen::Vector2d pixel{0, 0};        ///< [px]
};

/// Where the Huber loss bends. @param sigma of an observation, each axis [px]
double huberLimit(double sigma);

/// Robust normal equations of a pose, as the last iteration of poseFromPoints() has them.
/// @return nullopt with too few observations, or with less than half of them within the Huber limit
std::optional<PoseSums> poseEquations(const std::vector<PointObservation>& observations,
                                      const PinholeCamera& camera,
                                      const SE3& T_cam_host,
                                      double sigma);

/// Pose of a camera from points of known inverse depth: Gauss-Newton on the reprojection error with
/// a Huber loss, from a guess.
/// @param guess maps host to camera coordinates
/// @param sigma of an observation, each axis [px]
/// @return      nullopt with too few observations, or where it ends with less than half of them
/// within
///              the Huber limit
std::optional<SE3> poseFromPoints(const std::vector<PointObservation>& observations,
                                  const PinholeCamera& camera,
                                  const SE3& guess,
                                  double sigma);

}  // namespace dsorb::init_orb
