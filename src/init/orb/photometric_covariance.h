// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "init/orb/photometric_problem.h"

#include <Eigen/Core>

#include <array>
#include <vector>

namespace dsorb::init_orb {

/// Gradients of the reference at the pixels of a patch.
struct PatchGradients {
  std::array<float, kPatternSize> x{};  ///< [grey levels / px]
  std::array<float, kPatternSize> y{};
};
std::vector<PatchGradients> hostGradients(const PhotometricProblem& problem,
                                          const PyramidLevel& reference);

/// What the photometric equations say about their solution, in the gauge "reference pose and mean
/// inverse depth fixed".
struct PhotometricUncertainty {
  bool usable = false;
  double noise_variance = 0;    ///< s^2 = sum w r^2 / degrees of freedom [grey levels^2]
  Eigen::MatrixXd poses;        ///< joint, 6 a frame, robust against clustered errors
  Eigen::VectorXd own;          ///< by patch: max(s^2, s_i^2) / h [1/unit^2]; 0 unknown
  Eigen::VectorXd formal;       ///< by patch: s^2 (1 / h + g^T S^- g) [1/unit^2]
  Eigen::MatrixXd pose_effect;  ///< column i: -d inverse depth i / d poses (6 a frame) = g_i
  Eigen::VectorXd speed;        ///< by patch: motion along its gradient in the best frame [px unit]
};

/// Errors of pixels close together are not independent: the covariance of the poses sums the
/// gradient of the cost over cells of the image and takes the spread of these sums as it is.
/// @source experiments on rendered and real sequences, section A6; White, A Heteroskedasticity-
///         Consistent Covariance Matrix Estimator, Econometrica 1980, with clusters
PhotometricUncertainty estimateUncertainty(const PhotometricProblem& problem,
                                           const PhotometricState& state,
                                           const PyramidLevel& reference,
                                           const PhotometricOptions& options);

/// Sets the variances of corners and semi-dense points of an adjusted map, and the covariances of
/// its poses where the photometric ones were taken.
/// @param poses_moved the poses are the photometric ones
/// @return false when the equations tell nothing; the map is as before then
bool setPhotometricVariances(InitialMap& map,
                             const PinholeCamera& camera,
                             const PhotometricOptions& options,
                             bool poses_moved);

}  // namespace dsorb::init_orb
