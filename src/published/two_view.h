// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"

#include "features/corner_tracks.h"
#include "published/structure.h"

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <Eigen/LU>

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

namespace dsorb::published {

enum class Model { kHomography, kFundamental };

/// A 3x3 relation between two images with its support.
struct ScoredModel {
  Eigen::Matrix3d matrix = Eigen::Matrix3d::Zero();  ///< x_c ~ H x_r, or x_c^T F x_r = 0; pixels
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

/// rho_M, what a squared distance [px^2] adds to the score of a model with the threshold T_M.
/// @source [Gladkova], eq. (3); Gamma is chi-square, 2 degrees of freedom, 95 %
inline double supportOf(double squared_distance, double threshold) {
  constexpr double kGamma = 5.99;
  return squared_distance < threshold ? kGamma - squared_distance : 0.0;
}

/// Squared symmetric transfer distances of a match, in the target and in the reference [px^2].
/// @param back inverse of H, or transpose of F
/// @source [Gladkova], eq. (4) and (5), for F with the square and the norm of the line's direction
///         that the print lacks; Hartley and Zisserman, Multiple View Geometry, eq. (11.10)
std::array<double, 2> transferDistances(Model model,
                                        const Eigen::Matrix3d& matrix,
                                        const Eigen::Matrix3d& back,
                                        const Eigen::Vector2d& reference,
                                        const Eigen::Vector2d& target);

/// Score and inliers of a model over all matches.
/// @source [Gladkova], eq. (2)
ScoredModel scoreModel(Model model, const Eigen::Matrix3d& matrix, const Matches& matches);

/// Indices of a sample; a homography takes the first four.
using SampleIndices = std::array<std::uint32_t, 8>;

/// Homography through four matches by the direct linear transform, or the fundamental matrix
/// through eight with its smallest singular value set to zero.
/// @param matches of any scale; normalise pixels for accuracy
/// @return nullopt for a degenerate sample
/// @source Hartley and Zisserman, Multiple View Geometry, algorithms 4.2 and 11.1
std::optional<Eigen::Matrix3d> solveModel(Model model,
                                          const Matches& matches,
                                          const SampleIndices& sample);

/// Fits both models by RANSAC, at the same time; the result does not depend on the threads.
/// @param matches at least eight
/// @param seed    of the samples
ModelPair fitModels(const Matches& matches, std::uint64_t seed);

/// Which of the two models explains the matches.
enum class ModelChoice {
  kScore,   ///< by the homography's share of both scores
  kInliers  ///< the one with more inliers
};

/// A motion that a model allows, with the structure it implies.
struct Hypothesis {
  SE3 T_cur_ref;                                ///< translation of length 1
  std::vector<std::optional<MapPoint>> points;  ///< one a match; set where it is good
  int good = 0;                                 ///< good points among the model's inliers
  double parallax_deg = 0;                      ///< that 51 of them reach
};

/// The motion between two views, or the reason why there is none yet.
struct RelativeMotion {
  InitReason reason = InitReason::kDegenerateMotion;  ///< kDone when a motion was found
  Model model = Model::kFundamental;
  Hypothesis best;
  int inliers = 0;      ///< matches that fit the chosen model
  int second_good = 0;  ///< good points of the second-best motion
};

/// Fits both models, chooses one, decomposes it and chooses the motion that most points confirm.
/// @source Mur-Artal, Montiel, Tardos, ORB-SLAM, arXiv:1502.00956, section IV; [Gladkova],
///         section 3.2
RelativeMotion estimateMotion(const Matches& matches,
                              const PinholeCamera& camera,
                              ModelChoice choice,
                              std::uint64_t seed);

/// The first map: the newest frame posed by the motion and a corner for every good point, then the
/// poses of the frames between, from the corners or, where these do not agree, by interpolation.
/// @param frames one a frame of the tracks
/// @param motion reference to newest frame, its points in the order of the tracks
Map makeMap(const std::vector<FramePtr>& frames,
            const CornerTracks& tracks,
            const Hypothesis& motion,
            const PinholeCamera& camera);

}  // namespace dsorb::published
