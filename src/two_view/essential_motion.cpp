// SPDX-License-Identifier: BSD-3-Clause
#include "two_view/essential_motion.h"

#include "base/median.h"
#include "features/ransac.h"
#include "geometry/tangent_basis.h"
#include "geometry/triangulate.h"
#include "two_view/decomposition.h"
#include "two_view/motion_refinement.h"

#include <opencv2/calib3d.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace dsorb {
namespace {

constexpr int kMaxRounds = 1000;  // of RANSAC; it stops when it is sure
constexpr int kMinInliers = 50;
constexpr int kMinMatches = 8;  // of OpenCV's local optimisation
constexpr int kRefits = 2;      // of motion and inliers; the inliers then stay the same

/// Of the four motions of an essential matrix the one with most inliers in front of both cameras.
SE3 mostInFront(const std::vector<SE3>& motions,
                const Matches& matches,
                const std::vector<char>& inlier,
                const PinholeCamera& camera) {
  SE3 best;
  int most = -1;
  for (const SE3& motion : motions) {
    int in_front = 0;
    for (std::size_t i = 0; i < matches.size(); ++i) {
      if (inlier[i] == 0) continue;
      const Eigen::Vector3d ray = camera.unproject(matches.reference[i]);
      const Eigen::Vector2d target = camera.unproject(matches.target[i]).head<2>();
      const auto point = triangulateInverseDepth(motion, ray, target, 1);
      if (!point || !(point->inverse_depth > 0)) continue;
      const double z =
          (motion.unitQuaternion() * ray).z() + point->inverse_depth * motion.translation().z();
      if (z > 0) ++in_front;
    }
    if (in_front > most) {
      most = in_front;
      best = motion;
    }
  }
  return best;
}

}  // namespace

std::vector<double> epipolarDistances(const SE3& T_cur_ref,
                                      const Matches& matches,
                                      const PinholeCamera& camera) {
  const auto basis = tangentBasis(T_cur_ref.translation());
  std::vector<double> distances(matches.size());
  for (std::size_t i = 0; i < matches.size(); ++i) {
    distances[i] = camera.fx * std::abs(epipolarResidual(T_cur_ref,
                                                         camera.unproject(matches.reference[i]),
                                                         camera.unproject(matches.target[i]),
                                                         basis)
                                            .value);
  }
  return distances;
}

EssentialMotion refineOnInliers(const SE3& T_cur_ref,
                                const Matches& matches,
                                const PinholeCamera& camera,
                                double threshold) {
  EssentialMotion motion{T_cur_ref, std::vector<char>(matches.size(), 0)};
  for (int refit = 0; refit <= kRefits; ++refit) {
    std::vector<double> distances = epipolarDistances(motion.T_cur_ref, matches, camera);
    for (std::size_t i = 0; i < matches.size(); ++i) {
      motion.inlier[i] = distances[i] < threshold ? 1 : 0;
    }
    motion.inliers =
        static_cast<int>(std::count(motion.inlier.begin(), motion.inlier.end(), char{1}));
    const auto middle = distances.begin() + motion.inliers / 2;
    std::nth_element(distances.begin(), middle, distances.end());
    motion.noise = kMadToSigma * *middle;
    if (refit == kRefits || motion.inliers < kMinMatches) break;
    motion.T_cur_ref =
        refineMotion(motion.T_cur_ref, matches, motion.inlier, camera, threshold / 2);
  }
  return motion;
}

std::optional<EssentialMotion> estimateEssentialMotion(const Matches& matches,
                                                       const PinholeCamera& camera,
                                                       std::uint64_t seed) {
  if (static_cast<int>(matches.size()) < std::max(kMinMatches, kMinInliers)) {
    return std::nullopt;
  }
  const cv::Matx33d K = toCv(camera.matrix());
  const cv::Mat no_distortion = cv::Mat::zeros(1, 4, CV_64F);
  cv::Mat mask;
  const cv::Mat E = cv::findEssentialMat(toCv(matches.reference),
                                         toCv(matches.target),
                                         K,
                                         K,
                                         no_distortion,
                                         no_distortion,
                                         mask,
                                         ransacParameters(kRansacThreshold, kMaxRounds, seed));
  if (E.rows != 3 || E.cols != 3) return std::nullopt;
  std::vector<char> inlier(matches.size(), 0);
  for (std::size_t i = 0; i < inlier.size(); ++i) {
    inlier[i] = mask.at<std::uint8_t>(static_cast<int>(i)) != 0 ? 1 : 0;
  }
  const std::vector<SE3> motions = decomposeEssential(toEigen(E));
  if (motions.empty()) return std::nullopt;
  EssentialMotion motion = refineOnInliers(
      mostInFront(motions, matches, inlier, camera), matches, camera, kRansacThreshold);
  if (motion.inliers < kMinInliers) return std::nullopt;
  return motion;
}

}  // namespace dsorb
