// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/init/result.h"

#include <Eigen/Core>

#include <vector>

namespace dsorb {

/// Changes the unit of length so that an inverse depth `mean` becomes 1. It is done here only.
void changeUnit(double mean, std::vector<PosedFrame>& frames);
template <typename Scalar>
void changeUnit(double mean, Scalar& inverse_depth, Scalar& variance) {
  inverse_depth = static_cast<Scalar>(inverse_depth / mean);
  variance = static_cast<Scalar>(variance / (mean * mean));
}

/// Changes the unit of length so that the mean inverse depth of the reference's points is 1:
/// translations, inverse depths, variances and covariances alike. Used by every initializer.
/// @throws std::logic_error when that mean is not positive
void normalizeScale(InitializationResult& result);

/// Standard deviations of the direction of a frame's translation along the axes of its covariance,
/// the larger one last [deg].
/// @param frame with pose and covariance
Eigen::Vector2d directionSigmasDeg(const PosedFrame& frame);

/// Probability that a direction is off by more than an angle, for a t-distribution on its tangent
/// plane.
/// @param sigmas_deg along the axes of the covariance
double tailProbability(const Eigen::Vector2d& sigmas_deg, double angle_deg);

/// Probability that another motion is the right one.
/// @param cost_ratio of the other's robust cost over the best's
/// @param samples    independent ones
double rivalProbability(double cost_ratio, double samples);

}  // namespace dsorb
