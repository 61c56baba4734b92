// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/geometry/se3.h"

#include "features/corner_tracks.h"
#include "geometry/triangulate.h"

#include <Eigen/Core>

#include <cstdint>
#include <optional>
#include <vector>

namespace dsorb {

/// One possible motion with the structure it implies.
struct MotionHypothesis {
  SE3 T_cur_ref;                                         ///< translation of length 1
  std::vector<std::optional<TriangulatedPoint>> points;  ///< one a match; set where it is good
};

/// Motions that a homography allows (up to four), translations of length 1. Empty for a rotation.
std::vector<SE3> decomposeHomography(const Eigen::Matrix3d& H_cur_ref, const PinholeCamera& camera);
/// The four motions that an essential matrix allows, translations of length 1.
std::vector<SE3> decomposeEssential(const Eigen::Matrix3d& E);

/// Violation of the epipolar constraint by one match, with derivatives.
struct EpipolarResidual {
  double value = 0;               ///< x_t^T [t]x R x_r over the length of its image gradient
  Eigen::Matrix<double, 1, 5> J;  ///< of [rotation, left; t along tangentBasis(t)]
};

/// Sampson's distance of a match from the epipolar geometry of a motion, signed; the derivatives
/// hold its denominator fixed.
/// @param T_cur_ref translation of length 1
/// @param reference, target normalised rays, z = 1
/// @param basis        tangentBasis of the translation
/// @source Hartley and Zisserman, Multiple View Geometry, eq. (11.9); derivatives in
///         motion_hypotheses_test
EpipolarResidual epipolarResidual(const SE3& T_cur_ref,
                                  const Eigen::Vector3d& reference,
                                  const Eigen::Vector3d& target,
                                  const Eigen::Matrix<double, 3, 2>& basis);

/// Moves a motion to the minimum of Sampson's distance over the counted matches, with a Cauchy
/// loss. A linear model need not be an essential matrix: its decomposition is only near.
/// @param T_cur_ref translation of length 1
/// @param counted      one a match
/// @param sigma        of a corner's position, each axis [px]
/// @return             translation of length 1; the input where the equations are singular
SE3 refineMotion(const SE3& T_cur_ref,
                 const Matches& matches,
                 const std::vector<char>& counted,
                 const PinholeCamera& camera,
                 double sigma);

/// Distance from the epipolar line, or from where a homography wants the match, of an inlier [px].
constexpr double kRansacThreshold = 1;

/// Motion between two calibrated views with the matches that support it.
struct EssentialMotion {
  SE3 T_cur_ref;             ///< translation of length 1
  std::vector<char> inlier;  ///< one a match
  int inliers = 0;
  double noise = 0;  ///< robust standard deviation of a match about its epipolar lines [px]
};

/// Essential matrix by RANSAC over five matches with local optimisation, as many rounds as it takes
/// to be sure; then the motion that puts most matches in front, moved to the minimum of Sampson's
/// distance over the inliers.
/// @param seed of the samples
/// @return nullopt without a model or with too few inliers
/// @source Nister, An Efficient Solution to the Five-Point Relative Pose Problem, PAMI 2004; Chum,
///         Matas, Kittler, Locally Optimized RANSAC, DAGM 2003 (both as in OpenCV's USAC)
std::optional<EssentialMotion> estimateEssentialMotion(const Matches& matches,
                                                       const PinholeCamera& camera,
                                                       std::uint64_t seed);

/// Sampson's distance of every match from the epipolar geometry of a motion [px], unsigned.
std::vector<double> epipolarDistances(const SE3& T_cur_ref,
                                      const Matches& matches,
                                      const PinholeCamera& camera);

/// Marks and counts the matches that a motion explains.
/// @return epipolarDistances()
std::vector<double> countInliers(const Matches& matches,
                                 const PinholeCamera& camera,
                                 double threshold,
                                 EssentialMotion& motion);

}  // namespace dsorb
