// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/geometry/se3.h"

#include "features/corner_tracks.h"

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <cstdint>
#include <optional>
#include <vector>

namespace dsorb {

/// Models of the displacement between two views, simplest first.
enum class DisplacementModel { kRotation, kHomography, kEssential };

/// Name as in initialization.json, for example "homography".
[[nodiscard]] const char* name(DisplacementModel model);

/// Squared distances of all matches from a model [px^2]: of the four coordinates of a match to the
/// nearest ones that the model allows, to first order.
/// @source Hartley and Zisserman, Multiple View Geometry, section 4.2.6 (Sampson error)
std::vector<double> homographySampsonErrors(const Eigen::Matrix3d& H_cur_ref,
                                            const Matches& matches);
std::vector<double> rotationSampsonErrors(const Eigen::Quaterniond& R_cur_ref,
                                          const Matches& matches,
                                          const PinholeCamera& camera);

/// Geometric robust information criterion: the smaller, the better the model explains the matches
/// for its size.
/// @param squared_errors of all matches, outliers too [px^2]
/// @param sigma          of a coordinate of a match [px]
/// @source Torr, Geometric Motion Segmentation and Model Selection, 1998: r = 4, lambda1 = ln 4,
///         lambda2 = ln 4n; dimension and parameters: rotation 2, 3; homography 2, 8; essential
///         matrix 3, 5
double gric(DisplacementModel model, const std::vector<double>& squared_errors, double sigma);

/// Homography by RANSAC with local optimisation over all matches.
/// @param seed of the samples
std::optional<Eigen::Matrix3d> estimateHomography(const Matches& matches, std::uint64_t seed);

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
