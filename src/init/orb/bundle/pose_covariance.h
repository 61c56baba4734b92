// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/geometry/se3.h"
#include "dsorb/options/orb_mapping.h"

#include "init/orb/map/initial_map.h"

#include <Eigen/Core>

#include <array>

namespace dsorb::init_orb {

/// Second part of the error of a frame that is posed afterwards: inverse depths share the errors of
/// the poses they were adjusted with, and propagate them. With x the errors of the adjusted poses,
/// A_i = h_i / h_ii as in geometric_covariance.h and J = [J_t J_w] the projection's derivative by
/// the pose:
///   d rho_i = -A_i^T x,  d projection / d rho_i = J_t t / rho_i (exact),
///   error of the pose = sum_d t_d M_d x,  M_d = H^-1 sum_i J^T J_t,d A_i^T / rho_i.
/// M_d is taken once, where the camera has not moved, and turned with the camera: to first order in
/// the motion, and as if every frame saw every corner.
class InheritedPoseError {
 public:
  /// @param map adjusted, with its joint covariance
  InheritedPoseError(const InitialMap& map,
                     const PinholeCamera& camera,
                     const GeometricOptions& options);

  /// Rows: left increment of a pose; columns: those of InitialMap::joint_frames.
  [[nodiscard]] Eigen::Matrix<double, 6, Eigen::Dynamic> response(const SE3& T_cam_ref) const;
  [[nodiscard]] Matrix6d covariance(const SE3& T_cam_ref) const;

 private:
  std::array<Eigen::Matrix<double, 6, Eigen::Dynamic>, 3> response_;  ///< M, by axis of t
  Eigen::MatrixXd joint_;
};

/// Covariance of a pose that is only interpolated between adjusted frames: theirs, and half the
/// motion from one to the other as standard deviation along every axis.
/// @param frame index, between the reference and an adjusted frame
Matrix6d interpolatedCovariance(const InitialMap& map, std::size_t frame);

}  // namespace dsorb::init_orb
