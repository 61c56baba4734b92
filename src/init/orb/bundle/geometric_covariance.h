// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/options/orb_mapping.h"

#include "init/orb/map/initial_map.h"

namespace dsorb::init_orb {

/// Sets the covariance of every posed frame after the reference, the joint one of all of them and
/// the variance of every corner,
/// in the gauge "reference pose and mean inverse depth fixed", times the a-posteriori variance
/// factor s^2 = sum w e^2 / (observations - parameters) of the whitened errors e.
///
/// With A_i = h_i / h_ii (h_i: pose by inverse depth, h_ii: inverse depth block), S the Schur
/// complement over the inverse depths, n its null vector (all translations grow, inverse depths
/// rho shrink) and m = mean A_i:
///   poses           P S^- P^T + n n^T c,  P = I - n m^T,  c = sum(1 / h_ii) / N^2
///   inverse depth i 1 / h_ii (1 - 2 rho_i / N) + g_i^T S^- g_i + rho_i^2 c,  g_i = A_i - rho_i m
/// for any generalised inverse S^-, because P n = 0 and g_i^T n = 0. Tracks share the reference
/// patch and the calibration, neighbours share more: unless `options.pose_variance_factor` is 0 the
/// spread of the gradient over cells of the image is added to S^- (as in photometric_covariance.h),
/// and 1 / h_ii counts once for all frames. What is no noise (occlusions, wrong warps) does not
/// average out over cells either, and shows in the tails of the errors: that spread is multiplied
/// by pose_variance_factor (1 + tail_variance_factor * tailExcess), kept in `map.clustered_factor`.
/// @param map adjusted, mean inverse depth 1, every corner observed in a posed frame
/// @return the variance factor s^2 [-]; nothing is set and NaN returned when the problem has no
///         redundancy or is degenerate
/// @source derived from Triggs et al., Bundle Adjustment - A Modern Synthesis, section 9 (gauge
///         projection); compared with dense and sparse QR solutions in geometric_covariance_test;
///         White, A Heteroskedasticity-Consistent Covariance Matrix Estimator, Econometrica 1980
double setCovariances(InitialMap& map,
                      const PinholeCamera& camera,
                      const GeometricOptions& options);

}  // namespace dsorb::init_orb
