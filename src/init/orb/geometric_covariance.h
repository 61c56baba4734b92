// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/options/orb_mapping.h"

#include "init/orb/initial_map.h"

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
/// for any generalised inverse S^-, because P n = 0 and g_i^T n = 0. Unless
/// `options.effective_points` is 0 these formal variances are multiplied by factors that make them
/// predict real errors.
/// @param map adjusted, mean inverse depth 1, every corner observed in a posed frame
/// @return the variance factor s^2 [-]; nothing is set and NaN returned when the problem has no
///         redundancy or is degenerate
/// @source derived from Triggs et al., Bundle Adjustment - A Modern Synthesis, section 9 (gauge
///         projection); compared with a dense solution in geometric_adjustment_test
double setCovariances(InitialMap& map,
                      const PinholeCamera& camera,
                      const GeometricOptions& options);

}  // namespace dsorb::init_orb
