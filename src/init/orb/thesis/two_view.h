// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/options/orb.h"

#include "init/orb/tracks/corner_tracks.h"

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

namespace dsorb::init_orb {

enum class TwoViewModel { kHomography, kFundamental };

/// A 3x3 relation between two images with its support.
struct ScoredModel {
  Eigen::Matrix3d matrix = Eigen::Matrix3d::Zero();  ///< x_t ~ H x_r, or x_t^T F x_r = 0; pixels
  double score = 0;                                  ///< S_M; 0 when no sample gave a model
  std::vector<char> inlier;                          ///< one a match: below T_M in both images
  int inliers = 0;
};

/// Both models, fitted to the same samples.
struct ModelPair {
  ScoredModel homography;
  ScoredModel fundamental;

  /// S_H / (S_H + S_F); 1 when neither was found
  [[nodiscard]] double homographyShare() const {
    const double sum = homography.score + fundamental.score;
    return sum > 0 ? homography.score / sum : 1.0;
  }
};

/// Gamma of the score: chi-square, 2 degrees of freedom, 95 %; the same for both models so that
/// their scores compare.
constexpr double kGamma = 5.99;

/// Contribution of one squared distance to a model's score.
/// @param squared_distance over the measurement variance [-]
/// @param threshold        T_M
/// @source [Gladkova], eq. (3)
inline double supportOf(double squared_distance, double threshold) {
  return squared_distance < threshold ? kGamma - squared_distance : 0.0;
}

/// Squared symmetric transfer distances of a match under a homography [px^2].
/// @return {in the target, in the reference}
/// @source [Gladkova], eq. (4) and (5)
inline std::array<double, 2> homographyDistances(const Eigen::Matrix3d& H_cur_ref,
                                                 const Eigen::Matrix3d& H_ref_cur,
                                                 const Eigen::Vector2d& reference,
                                                 const Eigen::Vector2d& target) {
  const Eigen::Vector3d forward = H_cur_ref * reference.homogeneous();
  const Eigen::Vector3d backward = H_ref_cur * target.homogeneous();
  return {(forward.head<2>() / forward.z() - target).squaredNorm(),
          (backward.head<2>() / backward.z() - reference).squaredNorm()};
}

/// Squared distances of the points of a match to each other's epipolar lines [px^2].
/// @return {in the target, in the reference}
/// @source [Gladkova], eq. (4) and (5), with the square and the norm of the line's direction that
///         the print lacks; Hartley and Zisserman, Multiple View Geometry, eq. (11.10)
inline std::array<double, 2> fundamentalDistances(const Eigen::Matrix3d& F,
                                                  const Eigen::Vector2d& reference,
                                                  const Eigen::Vector2d& target) {
  const Eigen::Vector3d line_target = F * reference.homogeneous();
  const Eigen::Vector3d line_reference = F.transpose() * target.homogeneous();
  const double residual = target.homogeneous().dot(line_target);
  return {residual * residual / line_target.head<2>().squaredNorm(),
          residual * residual / line_reference.head<2>().squaredNorm()};
}

/// Score and inliers of a model over all matches.
/// @source [Gladkova], eq. (2)
ScoredModel scoreModel(TwoViewModel kind,
                       const Eigen::Matrix3d& matrix,
                       const Matches& matches,
                       double sigma);

/// Indices of a sample; a homography takes the first four.
using Sample = std::array<std::uint32_t, 8>;

/// Homography through four matches by the direct linear transform, or the fundamental matrix
/// through eight with its smallest singular value set to zero.
/// @param matches of any scale; normalise pixels for accuracy
/// @return nullopt for a degenerate sample
/// @source Hartley and Zisserman, Multiple View Geometry, algorithms 4.2 and 11.1
std::optional<Eigen::Matrix3d> solveModel(TwoViewModel kind,
                                          const Matches& matches,
                                          const Sample& sample);

/// Fits both models by RANSAC, at the same time; the result does not depend on the threads.
/// @param matches at least eight
/// @param seed    of the samples
ModelPair fitModels(const Matches& matches, std::uint64_t seed);

}  // namespace dsorb::init_orb
