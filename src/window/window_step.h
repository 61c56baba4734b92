// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/calibration.h"
#include "dsorb/options/window.h"

#include "window/normal_equations.h"
#include "window/window.h"

#include <Eigen/Core>

#include <cstddef>
#include <optional>
#include <vector>

/// One linear step of an adjustment: priors of the state, gauge, solution.

namespace dsorb::window {

/// What an adjustment of a window estimates of its camera.
[[nodiscard]] EstimatedCamera estimatedCamera(const Window& window, const WindowOptions& options);

/// Information of the prior of a keyframe's velocity, in scaled units.
[[nodiscard]] Vector6d velocityInformation(const Window& window, const Keyframe& keyframe);

/// Priors of frames and camera at the current state.
struct StatePrior {
  Eigen::VectorXd information;  ///< diagonal, scaled units
  Eigen::VectorXd gradient;
  double energy = 0;
  Eigen::Matrix4d guess = Eigen::Matrix4d::Zero();  ///< of guessed intrinsics, beside the diagonal
};
[[nodiscard]] StatePrior statePrior(const Window& window, const WindowOptions& options);

/// Columns: the six motions of the whole world and its scale, as changes of all frames' first
/// estimates (camera: zero), each of unit length.
/// @return dimension x 7
[[nodiscard]] Eigen::MatrixXd gaugeDirections(const Window& window);

/// Projects steps, one a column, onto the complement of motions and scale of the whole world. No
/// keyframe is held fixed here, as the reference is in the gauge of Marginals (src/estimate).
[[nodiscard]] Eigen::MatrixXd withoutGauge(const Eigen::MatrixXd& steps,
                                           const Eigen::MatrixXd& directions);

/// Step of camera and frames.
struct StateStep {
  Eigen::VectorXd change;
  Eigen::VectorXd gradient;  ///< of half the energy, priors included and depths eliminated
};

/// Step of frames and camera that minimises the linearised energy, priors included.
/// @param damping     relative increase of all diagonals
/// @param elimination afterwards gives the steps of the inverse depths
[[nodiscard]] StateStep solveStep(const Window& window,
                                  const WindowEquations& equations,
                                  const WindowOptions& options,
                                  double damping,
                                  WindowElimination& elimination);

/// How sure the result of an adjustment is.
struct WindowUncertainty {
  CameraVector camera_sigmas = CameraVector::Zero();  ///< of what is estimated [px; s]
  /// Covariance of the newest keyframe's pose: of xi = [translation; rotation] in
  /// exp(xi) * T_cam_world, in the gauge in which the keyframes as a whole are not moved, turned or
  /// scaled: a state's covariance C seen through P C P, P the projection onto the complement of
  /// gaugeDirections(). Nothing where the system does not determine it.
  /// @source Triggs et al., Bundle Adjustment - A Modern Synthesis, section 9.2: inner constraints
  std::optional<Matrix6d> newest_pose;
  /// Variances of the inverse depths in the same gauge, in the order of the equations: what their
  /// own pixels leave open, and what the errors of the frames add to it; 0 where nothing is known
  /// [1/unit^2].
  std::vector<float> depth_variances;
  /// The same where intrinsics and distortion are held: what the map itself leaves open, without
  /// what a focal length and a turn can trade. Nothing, too, as long as there are keyframes whose
  /// priors were forgotten: hardly anything else holds the older ones.
  std::optional<Matrix6d> newest_pose_camera_held;
};

/// @param noise of a pixel's residual [grey levels]
[[nodiscard]] WindowUncertainty uncertaintyOf(const Window& window,
                                              const WindowEquations& equations,
                                              const WindowOptions& options,
                                              double noise,
                                              WindowElimination& elimination);

/// What an adjusted window asks of a camera that it does not estimate: one linear step of focal
/// lengths, principal point and radial distortion beside the rest. The marginal prior, which was
/// made with the calibrated camera, does not count, nor does what else is known of depths. The
/// window's estimates stay.
/// @param noise of a pixel's residual [grey levels]
[[nodiscard]] CameraScore scoreCamera(Window& window, const WindowOptions& options, double noise);

}  // namespace dsorb::window
