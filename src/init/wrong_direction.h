// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/init/result.h"

#include <Eigen/Core>

namespace dsorb {

/// Standard deviations of the direction of a frame's translation along the axes of its covariance,
/// the larger one last [deg].
/// @param frame with pose and covariance
Eigen::Vector2d directionSigmasDeg(const PosedFrame& frame);

/// Probability that a direction is off by more than an angle, for a t-distribution on its tangent
/// plane.
/// @param sigmas_deg along the axes of the covariance
double tailProbability(const Eigen::Vector2d& sigmas_deg, double angle_deg);

/// Probability that another motion is the right one.
/// @param cost_ratio of the other's mean robust cost over the best's
/// @param samples    independent ones
double rivalProbability(double cost_ratio, double samples);

}  // namespace dsorb
