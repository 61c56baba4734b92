// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/geometry/se3.h"
#include "dsorb/options/brightness.h"

#include "track/pose_alignment.h"

#include <optional>

namespace dsorb::track {

/// Residuals are not independent: each point of the map stands on up to five pixels of level 0 and
/// brings the error of its inverse depth to all of them, and points near each other share errors of
/// the keyframes they were found with. So a pose is as sure as a seventh of the residuals would
/// make it. docs/experiments.md, "Covariance of tracked poses", has what it was chosen on.
constexpr double kResidualsPerMeasurement = 7;

/// Covariance of an aligned pose, of a left increment [translation; rotation]:
///   C = k s^2 (H^-1)_pose + m^2 [t; 0] [t; 0]^T,
/// H the Gauss-Newton matrix over pose and brightness, s^2 the mean Huber energy of a point, t the
/// translation. k and m are in the source, with their reasons.
/// @param equations of the finest level at `T_frame_reference`
/// @param rmse      of that level [grey levels]
/// @return nullopt where the points do not determine pose and brightness
[[nodiscard]] std::optional<Matrix6d> trackingCovariance(const PoseEquations& equations,
                                                         double rmse,
                                                         const SE3& T_frame_reference,
                                                         BrightnessModel brightness);

}  // namespace dsorb::track
