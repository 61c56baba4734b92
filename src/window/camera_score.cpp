// SPDX-License-Identifier: BSD-3-Clause
#include "window/camera_score.h"

#include "window/normal_equations.h"
#include "window/pair_geometry.h"
#include "window/window_step.h"

#include <Eigen/Core>

#include <utility>

namespace dsorb::window {
namespace {

constexpr double kFocalSigma = 0.5;  // relative: that nearly nothing is known of it

WindowOptions withGuessedCamera(WindowOptions options) {
  options.optimizer.optimize_intrinsics = true;
  options.prior.focal_sigma = kFocalSigma;
  return options;
}

}  // namespace

CameraScore scoreCamera(Window& window,
                        const WindowOptions& options,
                        double noise,
                        std::size_t chunks_per_task) {
  const WindowOptions guessed = withGuessedCamera(options);
  LinearizeOptions linearize;
  linearize.camera = estimatedCamera(window, guessed);
  linearize.depth_prior_factor = 0;
  linearize.chunks_per_task = chunks_per_task;
  NormalEquationsBuilder builder;
  WindowEquations equations;
  WindowElimination elimination;
  builder.build(window, PairTable(window), allPoints(window), linearize, equations);

  const Eigen::Index size = window.dimension();
  const MarginalPrior kept =
      std::exchange(window.prior, {Eigen::MatrixXd::Zero(size, size), Eigen::VectorXd::Zero(size)});
  const Eigen::VectorXd step = solveStep(window, equations, guessed, 0, elimination).change;
  const CameraVector sigmas =
      uncertaintyOf(window, equations, guessed, noise, elimination).camera_sigmas;
  window.prior = kept;

  const PinholeCamera& camera = window.first_camera;
  return {0.5 * kCameraScale * (step[0] / camera.fx + step[1] / camera.fy),
          0.5 * (sigmas[0] / camera.fx + sigmas[1] / camera.fy),
          {kRadialScale * step[kRadial], sigmas[kRadial]}};
}

}  // namespace dsorb::window
