// SPDX-License-Identifier: BSD-3-Clause
#pragma once

/// Factors that no model gives: what errors exceed their predicted variances by, as measured.
/// scripts/variance_factors.py measures in one run what five of them should be.
namespace dsorb::variance_factors {

/// Relative growth of the clustered covariance of a start per unit by which the tails of its errors
/// exceed a Gaussian's [-].
constexpr double kStartTail = 4;
/// Scale of the t-distribution of a start's direction over its predicted sigmas [-].
constexpr double kStartDirection = 1.5;
/// Sigma of a row motion's prior over the one that the poses of a start show, which are still noisy
/// when it is measured [-].
constexpr double kRowMotion = 0.5;
/// Errors of a window's adjustment over those of independent pixels [-]: the eight pixels of a
/// patch err together, and a fault of a host's patch is in all of its residuals.
constexpr double kWindow = 6;
/// Share of a keyframe's covariance that its frames get for errors of the map [-].
constexpr double kMapShare = 0.5;
/// Relative sigma of the scale between a keyframe and its frames, which alignment cannot see [-].
constexpr double kTrackedScale = 0.002;
/// Errors of a camera that was found over those of independent corners [-].
constexpr double kFoundCamera = 8;

}  // namespace dsorb::variance_factors
