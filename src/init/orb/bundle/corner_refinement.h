// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/geometry/se3.h"
#include "dsorb/options/orb.h"
#include "dsorb/options/orb_mapping.h"

#include "init/orb/map/initial_map.h"

#include <Eigen/Core>

#include <array>
#include <functional>
#include <vector>

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

/// Options for the adjustment of refined corners: sigma 1, because each observation is whitened by
/// its own covariance, and a redescending loss.
GeometricOptions refinedAdjustment(const GeometricOptions& geometric);

/// Corners measured again by aligning warped patches.
struct RefinementReport {
  bool accepted = false;  ///< the refined corners were taken
  bool fits = true;       ///< at least half of the corners match the images
  double first_rms = 0;   ///< error of the patches' pixels before the first step [grey levels]
  double last_rms = 0;    ///< error of the patches' pixels before the last step [grey levels]
  double direction_change_deg = 0;  ///< change of the direction of the newest translation [deg]
};

/// Measures every corner again in every posed frame and adjusts, several times. The patch of the
/// reference is warped by pose and inverse depth, so the measurement does not drift as tracking
/// from frame to frame does, and knows its covariance. Runs in parallel inside the caller's arena.
/// @param map       adjusted; unchanged unless the refinement is accepted: the pixels fit no worse
///                  than before, most corners do, and the direction of translation hardly changed
/// @param geometric of the adjustment before: sigma of the tracks
/// @param hopeless  asked after the first round, which nearly reaches what the others do: whether
///                  they would be in vain; they are left out then
RefinementReport refineCorners(InitialMap& map,
                               const PinholeCamera& camera,
                               const GeometricOptions& geometric,
                               const std::function<bool(const InitialMap&)>& hopeless = {});

/// Refines the poses of single frames by the same measurements, with all inverse depths and all
/// other poses fixed. Sets the brightness and the covariance of the frames as well.
/// @param map       every frame posed, adjusted frames with their joint covariance; observations
///                  are left as they are
/// @param geometric of the adjustment: its robust loss
/// @param frames    indices, none of them adjusted nor the reference
void refinePoses(InitialMap& map,
                 const PinholeCamera& camera,
                 const GeometricOptions& geometric,
                 const std::vector<std::size_t>& frames);

}  // namespace dsorb::init_orb
