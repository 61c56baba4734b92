// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"

#include "features/corner_tracks.h"

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace dsorb {

/// Median rotation-compensated flow, as an angle; less is no parallax.
constexpr double kMinRotationResidualDeg = 0.3;

struct RotationFit {
  Eigen::Quaterniond R_cur_ref = Eigen::Quaterniond::Identity();
  double median_residual = 0;  ///< rotation-compensated flow [px]
};

/// The rotation that explains the matches best, without any translation. Robust: it minimises the
/// sum of the chord lengths between bearings, so that less than half of them may be wrong.
/// @param matches not empty
/// @source Arun, Huang, Blostein, Least-Squares Fitting of Two 3-D Point Sets (the weighted SVD
///         step); weights 1 / residual as Weiszfeld's
RotationFit fitRotation(const Matches& matches, const PinholeCamera& camera);

/// Median rotation-compensated flow, as an angle: the parallax that no rotation explains.
/// @param matches not empty
double rotationResidualDeg(const Matches& matches, const PinholeCamera& camera);

}  // namespace dsorb
