// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/geometry/se3.h"
#include "dsorb/image/pyramid.h"

#include "estimate/linear_system.h"
#include "image/photometric.h"
#include "init/coarse/coarse_points.h"

#include <Eigen/Core>

namespace dsorb::init_coarse {

using Vector8d = Eigen::Matrix<double, 8, 1>;
using Matrix8d = Eigen::Matrix<double, 8, 8>;

/// What is estimated of the newest frame. Parameters and their increments are ordered [translation;
/// rotation; log gain; offset].
struct Alignment {
  SE3 T_cur_ref;
  double log_gain = 0;           ///< I_new = e^log_gain I_ref + offset
  double offset = 0;             ///< [grey levels]
  double exposure_log_gain = 0;  ///< what the exposure times say of log_gain; 0: unknown
  bool snapped = false;          ///< translation has left the prior once
  /// Residuals are divided by the root of the gain, beyond what the exposures say: both images
  /// count alike. With least squares alone the gain falls with the share of the images that does
  /// not match.
  /// @source geometric mean regression, minimum of (I_new - g I_ref - b)^2 / g
  bool balanced = false;
};

/// One level of the newest frame.
struct LevelView {
  const PyramidLevel* image;
  PinholeCamera camera;
};

/// Quadratic terms on every inverse depth.
struct DepthPull {
  float prior = 0;     ///< weight toward 1
  float coupling = 0;  ///< weight toward the smoothed inverse depth
};

/// Sums over the points of a level.
struct LevelSums {
  double energy = 0;       ///< bad points count with their last accepted one [grey levels^2]
  double good_energy = 0;  ///< of the good points
  int good = 0;
  int inliers = 0;  ///< good with a pattern energy of at most kPatternOutlierEnergy
  LevelSums& operator+=(const LevelSums& other);

  /// Energy in which every point that is not good counts as an outlier.
  [[nodiscard]] double robustEnergy(int points) const {
    return good_energy + static_cast<double>(kPatternOutlierEnergy) * (points - good);
  }
};

constexpr float kMaxPatternEnergy = 20 * kPatternOutlierEnergy;  // above, the point is bad

/// Evaluates all points of a level at their trial inverse depths: writes trial energy, curvature,
/// flag and the step limit, and the normal equations over the eight parameters and the inverse
/// depths of the good points. Same bits for any number of threads.
/// @param system of the photometric energy; depth terms act on the inverse depths only, whose
///               curvature is 1 more, so that flat regions stay where they are
/// @source residual r = I_new(p') - e^a I_ref(p) - b over the 8-pixel pattern, DSO,
/// arXiv:1607.02565,
///         eq. (4) without gradient weights; Jacobians derived in coarse_residual_test
LevelSums evaluateLevel(const LevelView& view,
                        const Alignment& alignment,
                        const DepthPull& pull,
                        PointLevel& points,
                        LinearSystem<float>& system);

}  // namespace dsorb::init_coarse
