// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/geometry/se3.h"

#include "features/corner_tracks.h"

#include <cstdint>
#include <optional>
#include <vector>

namespace dsorb {

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

/// The motion moved to the minimum over its inliers, and its inliers counted anew.
EssentialMotion refineOnInliers(const SE3& T_cur_ref,
                                const Matches& matches,
                                const PinholeCamera& camera,
                                double threshold);

/// Sampson's distance of every match from the epipolar geometry of a motion [px], unsigned.
std::vector<double> epipolarDistances(const SE3& T_cur_ref,
                                      const Matches& matches,
                                      const PinholeCamera& camera);

}  // namespace dsorb
