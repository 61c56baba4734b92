// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/geometry/se3.h"
#include "dsorb/image/pyramid.h"

#include "image/photometric.h"
#include "init/coarse/coarse_points.h"

#include <Eigen/Core>

#include <cstddef>
#include <vector>

namespace dsorb::init_coarse {

using Vector8d = Eigen::Matrix<double, 8, 1>;
using Matrix8d = Eigen::Matrix<double, 8, 8>;

/// What is estimated of the newest frame. Parameters and their increments are ordered [translation;
/// rotation; log gain; offset].
struct Alignment {
  SE3 T_new_ref;
  double log_gain = 0;           ///< I_new = e^log_gain I_ref + offset
  double offset = 0;             ///< [grey levels]
  double exposure_log_gain = 0;  ///< what the exposure times say of log_gain; 0: unknown
  bool snapped = false;          ///< translation has left the prior once
  /// Residuals are divided by the root of the gain, beyond what the exposures say: both images
  /// count alike. By least squares alone the gain falls with the share of the images that does not
  /// match.
  /// @source geometric mean regression, minimum of (I_new - g I_ref - b)^2 / g
  bool balanced = false;
};

/// One level of the newest frame.
struct LevelView {
  const PyramidLevel* image;
  PinholeCamera camera;
};

/// Quadratic terms on every inverse depth.
struct DepthTerms {
  float prior = 0;     ///< weight toward 1
  float coupling = 0;  ///< weight toward the smoothed inverse depth
};

/// Terms of every point that the Schur complement needs: coupling of its inverse depth with the
/// eight parameters, gradient and inverse of the damped curvature.
struct SchurTerms {
  std::vector<float> coupling;  ///< 8 a point
  std::vector<float> gradient;
  std::vector<float> inverse_curvature;
  void resize(std::size_t points);
};

/// Sums over the good points of a level: H = sum w J J^T, b = sum w J r, and what eliminating the
/// inverse depths takes away from both.
struct NormalEquations {
  Matrix8d H = Matrix8d::Zero();
  Vector8d b = Vector8d::Zero();
  Matrix8d H_schur = Matrix8d::Zero();
  Vector8d b_schur = Vector8d::Zero();
  double energy = 0;       ///< bad points count with their last accepted one
  double good_energy = 0;  ///< of the good points
  int good = 0;
  int inliers = 0;  ///< good with a pattern energy of at most kPatternOutlierEnergy
  NormalEquations& operator+=(const NormalEquations& other);
};

constexpr float kMaxPatternEnergy = 20 * kPatternOutlierEnergy;  // above, the point is bad

/// Evaluates all points of a level at their trial inverse depths: writes trial energy, curvature
/// and flag, the step limit and the Schur terms, and sums the normal equations. Same bits for any
/// number of threads.
/// @return equations of the photometric energy; depth terms act on the Schur parts only
/// @source residual r = I_new(p') - e^a I_ref(p) - b over the 8-pixel pattern, DSO,
/// arXiv:1607.02565,
///         eq. (4) without gradient weights; Jacobians derived in coarse_residual_test
NormalEquations evaluateLevel(const LevelView& view,
                              const Alignment& alignment,
                              const DepthTerms& terms,
                              PointLevel& points,
                              SchurTerms& schur);

}  // namespace dsorb::init_coarse
