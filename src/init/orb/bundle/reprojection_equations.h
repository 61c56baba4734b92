// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/options/orb_mapping.h"

#include "estimate/linear_system.h"
#include "estimate/warp.h"
#include "init/orb/bundle/reprojection_kernels.h"
#include "init/orb/map/initial_map.h"

#include <Eigen/Core>

#include <optional>
#include <vector>

namespace dsorb::init_orb {

/// Rows of the posed frames' unknowns in the equations.
struct PoseRows {
  explicit PoseRows(const InitialMap& map);
  /// @param frames posed, ascending, without the reference; no others have rows
  PoseRows(const InitialMap& map, const std::vector<int>& frames);

  std::vector<int> first;  ///< one a frame; -1 for the reference and unposed frames
  int size = 0;            ///< of all poses together
};

/// Direction in which all translations grow together: it leaves every projection unchanged.
Eigen::VectorXd scaleDirection(const InitialMap& map, const PoseRows& rows);

/// State of an adjustment: poses of the posed frames after the reference, and inverse depths of the
/// corners, filled up with zeros to whole lanes.
struct ReprojectionState {
  std::vector<SE3> T_cam_ref;
  std::vector<double> inverse_depth;

  ReprojectionState(const InitialMap& map, const PoseRows& rows);
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

/// Observations of the kept corners in posed frames, arranged for the kernels. Runs in parallel
/// inside the caller's arena; sums are added in an order that does not depend on it.
class ReprojectionProblem {
 public:
  /// @param kept one a corner; empty: all
  ReprojectionProblem(const InitialMap& map,
                      const std::vector<char>& kept,
                      const PoseRows& rows,
                      const PinholeCamera& camera,
                      const GeometricOptions& options);

  void linearize(const ReprojectionState& state, ReprojectionEquations& equations) const;

  [[nodiscard]] std::size_t frames() const { return sightings_.size(); }
  /// Corners, filled up to whole lanes.
  [[nodiscard]] std::size_t stride() const { return ray_x_.size(); }

 private:
  struct Sightings {
    std::vector<double> pixel_x, pixel_y, information_xx, information_xy, information_yy;
  };
  [[nodiscard]] SightingRun run(std::size_t frame,
                                std::size_t first,
                                std::size_t count,
                                const ReprojectionState& state) const;

  PinholeCamera camera_;
  LossSetting loss_;
  std::vector<double> ray_x_;
  std::vector<double> ray_y_;
  std::vector<Sightings> sightings_;  ///< by posed frame
};

/// Equations of a map. @param kept one flag a corner; empty stands for all
ReprojectionEquations linearize(const InitialMap& map,
                                const std::vector<char>& kept,
                                const PoseRows& pose_rows,
                                const PinholeCamera& camera,
                                const GeometricOptions& options);

/// Whether every corner has part in the equations.
bool allKnown(const LinearSystem<double>& system, const InitialMap& map);

/// Where the corner of an observation is expected; nullopt behind the camera.
/// @param observation of a frame with pose
std::optional<HostedProjection> projectCorner(const InitialMap& map,
                                              const PinholeCamera& camera,
                                              const Observation& observation);

/// Robust loss of one observation, as Ceres counts it. @param error whitened, at least 0
double robustCost(double error, const GeometricOptions& options);

/// Its derivative by half the squared error.
double robustWeight(double error, const GeometricOptions& options);

/// Half the sum of the robust loss, as Ceres counts it; nullopt when a point is behind a camera.
std::optional<double> reprojectionCost(const InitialMap& map,
                                       const std::vector<char>& kept,
                                       const PinholeCamera& camera,
                                       const GeometricOptions& options);

}  // namespace dsorb::init_orb
