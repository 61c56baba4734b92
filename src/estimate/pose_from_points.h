// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/geometry/se3.h"

#include "estimate/reprojection_kernels.h"

#include <Eigen/Core>

#include <optional>
#include <vector>

namespace dsorb {

constexpr double kTrackSigma = 1;  ///< of tracks, generous: the inverse depths may be rough [px]

/// A hosted point and where a camera saw it.
struct PointObservation {
  Eigen::Vector3d host_ray{0, 0, 1};  ///< z = 1
  double inverse_depth = 0;           ///< [1/unit]
  Eigen::Vector2d pixel{0, 0};        ///< [px]
};

/// Where the Huber loss bends. @param sigma of an observation, each axis [px]
double huberLimit(double sigma);

/// Pose of a camera from points of known inverse depth: Gauss-Newton on the reprojection error with
/// a Huber loss, from a guess.
/// @param guess maps host to camera coordinates
/// @param sigma of an observation, each axis [px]
/// @return      nullopt with too few observations, or where it ends with less than half of them
///              within the Huber limit
std::optional<SE3> poseFromPoints(const std::vector<PointObservation>& observations,
                                  const PinholeCamera& camera,
                                  const SE3& guess,
                                  double sigma);

/// Noise model of the observations that a pose was fitted to.
struct ObservationNoise {
  double sigma = 1;            ///< of an observation, each axis: where the loss bends [px]
  double variance_factor = 0;  ///< on the clustered covariance [-]; 0 takes the formal one
};

/// Covariance that the observations' own errors give a pose fitted to them by poseFromPoints(), the
/// points taken as exact: s^2 H^-1, plus the spread of the gradient over cells of the image, plus
/// the square of the step that the observations still ask for (none where the pose was fitted to
/// just these). It includes the independent errors of the inverse
/// depths, because they show in the residuals.
/// @param T_cam_host the fitted pose
/// @return of a left increment; nullopt where poseFromPoints() would not take the pose
/// @source White, Econometrica 1980, with clusters
std::optional<Matrix6d> poseCovariance(const std::vector<PointObservation>& observations,
                                       const PinholeCamera& camera,
                                       const SE3& T_cam_host,
                                       const ObservationNoise& noise);

}  // namespace dsorb
