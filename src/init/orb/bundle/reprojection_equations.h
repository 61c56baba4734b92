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

#include <array>
#include <cstddef>
#include <optional>
#include <vector>

/// Normal equations of a map's reprojection errors. Where rows were exposed at different times,
/// observations are kept at the time of the middle row, where the map's motions have moved them;
/// what these motions are wrong by is unknown as well: an observation depends on the velocity of
/// its frame as on its pose, times the time of the row that sees it, and on that of the reference,
/// times that of the hosting row.
/// @source Schubert et al., Direct Sparse Odometry with Rolling Shutter, ECCV 2018
namespace dsorb::init_orb {

constexpr int kMotionSize = 2 * kPoseSize;
using Motion = Eigen::Matrix<double, kMotionSize, 1>;  ///< velocity, then acceleration

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

/// How the pose between two rows depends on the left increments of a frame's pose, on its velocity
/// and acceleration, and on the reference's velocity and acceleration, the latter two seen from the
/// frame: one factor each.
constexpr int kFactors = 5;
using MotionFactors = Eigen::Matrix<double, kFactors, 1>;
/// @param target, host times of the rows [s]
inline MotionFactors motionFactors(double target, double host) {
  return {1, target, 0.5 * target * target, -host, -0.5 * host * host};
}

/// Rows of the unknowns: the poses of the posed frames, then, where rows move, velocity and
/// acceleration of the same frames, then those of the reference.
struct UnknownRows {
  explicit UnknownRows(const InitialMap& map);

  std::vector<int> first;  ///< of each frame's pose; -1 for the reference and unposed frames
  int poses = 0;           ///< rows of all poses together
  bool rolling = false;    ///< whether rows move

  [[nodiscard]] int frames() const { return poses / kPoseSize; }
  [[nodiscard]] int motion(int pose_row) const { return poses + 2 * pose_row; }
  [[nodiscard]] int motionOfReference() const { return motion(poses); }
  [[nodiscard]] int size() const { return rolling ? motionOfReference() + kMotionSize : poses; }
  /// Index of a frame's motion; none where the frame takes no part.
  [[nodiscard]] std::optional<std::size_t> motionIndex(std::size_t frame) const {
    const int row = frame == 0 ? poses : first[frame];
    return row < 0 ? std::nullopt : std::optional(static_cast<std::size_t>(row / kPoseSize));
  }
  /// Adds to a vector of all unknowns what a vector by a pose's increments means for them.
  /// @param adjoint of the pose
  void addByFactors(const Vector6d& by_pose,
                    int pose_row,
                    const MotionFactors& of_observation,
                    const Matrix6d& adjoint,
                    Eigen::Ref<Eigen::VectorXd> all) const;
  /// Direction in which all translations grow together, over all unknowns.
  [[nodiscard]] Eigen::VectorXd scaleDirection(const InitialMap& map) const;

  /// Rows of the unknowns that the factors stand for.
  [[nodiscard]] std::array<int, kFactors> ofFactors(int pose_row) const {
    const int of_frame = motion(pose_row);
    const int of_reference = motionOfReference();
    return {pose_row, of_frame, of_frame + kPoseSize, of_reference, of_reference + kPoseSize};
  }
};

/// Times of the rows that see the corners, relative to the middle rows [s].
struct RowTimesOfMap {
  std::vector<double> host;    ///< one a corner
  std::vector<double> target;  ///< one an observation

  /// @param map with motions; zeros without
  RowTimesOfMap(const InitialMap& map, const PinholeCamera& camera);

  [[nodiscard]] MotionFactors factors(std::size_t observation, std::size_t corner) const {
    return motionFactors(target[observation], host[corner]);
  }
};

/// State of an adjustment.
struct ReprojectionState {
  std::vector<SE3> T_cam_ref;         ///< of the posed frames after the reference
  std::vector<double> inverse_depth;  ///< of the corners, filled up with zeros to whole lanes
  /// Added to the map's motions: one a posed frame, then that of the reference. Empty: none.
  std::vector<Motion> motion_change;

  ReprojectionState(const InitialMap& map, const UnknownRows& rows);
};

/// Robustly weighted normal equations over UnknownRows and the inverse depths of a
/// ReprojectionState, with the map's priors of the velocities. Points behind a camera have no part.
struct ReprojectionEquations {
  LinearSystem<double> system;
  double cost = 0;             ///< half the sum of the robust loss, as Ceres counts it; infinite
                               ///< where a point is behind a camera that sees it
  double weighted_square = 0;  ///< sum of w e^2 [-]
  int rows = 0;                ///< scalar observations
};

ReprojectionEquations linearize(const InitialMap& map,
                                const UnknownRows& rows,
                                const PinholeCamera& camera,
                                const GeometricOptions& options);

/// Error of an observation over its noise, with derivatives by its frame's pose and inverse depth.
struct WhitenedError {
  Eigen::Vector2d value;
  Eigen::Matrix<double, 2, kPoseSize> J_pose;
  Eigen::Vector2d J_depth;

  /// @param sigma that the observation's whitening lacks
  WhitenedError(const CornerObservation& observation,
                const HostedProjection& projection,
                double sigma) {
    const Eigen::Matrix2d whitening = observation.whitening / sigma;
    value = whitening * (projection.pixel - observation.pixel);
    J_pose = whitening * projection.J_pose;
    J_depth = whitening * projection.J_inverse_depth;
  }
  /// The component that no inverse depth changes; nothing where the images show none.
  [[nodiscard]] std::optional<double> across() const {
    const double length = J_depth.norm();
    if (!(length > 0)) return std::nullopt;
    return std::abs(J_depth.x() * value.y() - J_depth.y() * value.x()) / length;
  }
};

/// Where the corner of an observation is expected; nullopt behind the camera.
/// @param observation of a frame with pose
std::optional<HostedProjection> projectCorner(const InitialMap& map,
                                              const PinholeCamera& camera,
                                              const CornerObservation& observation);

/// The error of an observation at the map's estimate; nullopt behind the camera.
/// @param observation of a frame with pose
std::optional<WhitenedError> errorOf(const InitialMap& map,
                                     const PinholeCamera& camera,
                                     const CornerObservation& observation,
                                     double sigma = 1);

/// Robust loss of one observation, as Ceres counts it. @param error whitened, at least 0
double robustCost(double error, const GeometricOptions& options);

/// Its derivative by half the squared error.
double robustWeight(double error, const GeometricOptions& options);

/// Half the sum of the robust loss, as Ceres counts it; nullopt when a point is behind a camera.
std::optional<double> reprojectionCost(const InitialMap& map,
                                       const PinholeCamera& camera,
                                       const GeometricOptions& options);

/// Moves the poses of all posed frames but the first and the inverse depths of the corners to the
/// minimum of the reprojection errors with the robust loss of the options; where rows move, the
/// motions as well, and pixels to where the motions found would have them at the times of the
/// middle rows. The scale stays about where it was.
/// @param map observations sorted by corner; every corner in front of all cameras that see it
/// @return    iterations, or nullopt when no usable numbers were found
/// @source Triggs et al., Bundle Adjustment - A Modern Synthesis, section 6.1 (Schur complement);
///         Madsen, Nielsen, Tingleff, Methods for Non-Linear Least Squares Problems, algorithm 3.16
///         (damping)
std::optional<int> solveGeometry(InitialMap& map,
                                 const PinholeCamera& camera,
                                 const GeometricOptions& options,
                                 const Stopping& stopping = {});

}  // namespace dsorb::init_orb
