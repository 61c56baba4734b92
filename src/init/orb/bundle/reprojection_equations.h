// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/geometry/se3.h"
#include "dsorb/options/orb_mapping.h"

#include "estimate/linear_system.h"
#include "estimate/reprojection_kernels.h"
#include "estimate/schur_problem.h"
#include "estimate/warp.h"
#include "init/orb/map/initial_map.h"

#include <Eigen/Core>

#include <cstddef>
#include <optional>
#include <vector>

namespace dsorb::init_orb {

/// Normal equations of known motions, poses' left increments in six rows each. They are Gaussians,
/// because adjustWithMotions() refuses those that contradict the images. Known translations are in
/// metres and the map is not: the metres of a unit are eliminated at their best value, so that the
/// equations say nothing of the map's scale.
struct MotionEquations {
  Eigen::MatrixXd H;
  Eigen::VectorXd b;
  double cost = 0;    ///< half the squared, whitened errors
  double metres = 0;  ///< of a unit, at least 0 [m]; 0 where no translation is known
  int rows = 0;       ///< errors, less one for the scale
};

/// @param motions   indices into the poses; from KnownMotion::kReference: the reference
/// @param T_cam_ref poses in the map's unit
MotionEquations motionEquations(const std::vector<KnownMotion>& motions,
                                const std::vector<SE3>& T_cam_ref);

constexpr std::size_t kCornerBlock = 64;  ///< corners that one thread takes at a time

/// Rows of the posed frames' unknowns in the equations.
struct PoseRows {
  explicit PoseRows(const InitialMap& map);

  std::vector<int> first;  ///< one a frame; -1 for the reference and unposed frames
  int size = 0;            ///< of all poses together
};

/// State of an adjustment: poses of the posed frames after the reference, and inverse depths of the
/// corners, filled up with zeros to whole lanes.
struct ReprojectionState {
  std::vector<SE3> T_cam_ref;
  std::vector<double> inverse_depth;

  ReprojectionState(const InitialMap& map, const PoseRows& rows);
  /// Becomes another state after a step.
  void moveFrom(const ReprojectionState& from, const DampedSolver& solution);
  void writeTo(InitialMap& map, const PoseRows& rows) const;
};

/// Robustly weighted normal equations over poses (left increments) and inverse depths, the latter
/// as many as ReprojectionState has. Points behind a camera have no part.
struct ReprojectionEquations {
  LinearSystem<double> system;
  double cost = 0;             ///< half the sum of the robust loss, as Ceres counts it; infinite
                               ///< where a point is behind a camera that sees it
  double weighted_square = 0;  ///< sum of w e^2 [-]
  int rows = 0;                ///< scalar observations
};

/// What the caller knows of the inverse depths and of the motions between posed frames.
class KnownTerms {
 public:
  KnownTerms(const InitialMap& map, const PoseRows& rows);
  /// @param equations whose first unknowns are the poses
  void addTo(ReprojectionEquations& equations, const ReprojectionState& state) const;

 private:
  std::vector<KnownInverseDepth> depths_;  ///< by corner; empty: none
  std::vector<KnownMotion> motions_;       ///< frames are indices of posed ones
};

/// Observations in posed frames, arranged for the kernels. Runs in parallel
/// inside the caller's arena; sums are added in an order that does not depend on it.
class ReprojectionProblem {
 public:
  ReprojectionProblem(const InitialMap& map,
                      const PoseRows& rows,
                      const PinholeCamera& camera,
                      const GeometricOptions& options);

  void linearize(const ReprojectionState& state, ReprojectionEquations& equations) const;
  static void move(const ReprojectionState& from,
                   const DampedSolver& solution,
                   ReprojectionState& to) {
    to.moveFrom(from, solution);
  }

  [[nodiscard]] std::size_t frames() const { return observations_.size(); }
  /// Corners, filled up to whole lanes.
  [[nodiscard]] std::size_t stride() const { return ray_x_.size(); }

 private:
  struct FrameObservations {
    std::vector<double> pixel_x, pixel_y, information_xx, information_xy, information_yy;
  };
  [[nodiscard]] ObservationRun run(std::size_t frame,
                                   std::size_t first,
                                   std::size_t count,
                                   const ReprojectionState& state) const;

  PinholeCamera camera_;
  LossSetting loss_;
  std::vector<double> ray_x_;
  std::vector<double> ray_y_;
  std::vector<FrameObservations> observations_;  ///< by posed frame
  KnownTerms known_;
};

/// Equations of a map.
ReprojectionEquations linearize(const InitialMap& map,
                                const PoseRows& pose_rows,
                                const PinholeCamera& camera,
                                const GeometricOptions& options);

/// Where the corner of an observation is expected; nullopt behind the camera.
/// @param observation of a frame with pose
std::optional<HostedProjection> projectCorner(const InitialMap& map,
                                              const PinholeCamera& camera,
                                              const CornerObservation& observation);

/// Robust loss of one observation, as Ceres counts it. @param error whitened, at least 0
double robustCost(double error, const GeometricOptions& options);

/// Its derivative by half the squared error.
double robustWeight(double error, const GeometricOptions& options);

/// Half the sum of the robust loss, as Ceres counts it; nullopt when a point is behind a camera.
std::optional<double> reprojectionCost(const InitialMap& map,
                                       const PinholeCamera& camera,
                                       const GeometricOptions& options);

/// solveWithSchur() of a map whose frames were each exposed at one time.
std::optional<int> solveReprojections(InitialMap& map,
                                      const PinholeCamera& camera,
                                      const GeometricOptions& options,
                                      const Stopping& stopping);

}  // namespace dsorb::init_orb
