// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/thesis/two_view_motion.h"

#include "init/orb/two_view/motion_refinement.h"

#include <algorithm>
#include <utility>
#include <vector>

namespace dsorb::init_orb {
namespace {

InitReason judge(const TwoViewMotion& motion, const TwoViewOptions& options) {
  const int good = motion.best.good;
  if (motion.inliers < options.min_triangulated) return InitReason::kTooFewPoints;
  const double needed = std::max(options.min_good_share * motion.inliers,
                                 static_cast<double>(options.min_triangulated));
  if (good < needed) return InitReason::kPoorQuality;
  if (motion.second_good > options.max_second_share * good) return InitReason::kDegenerateMotion;
  if (motion.best.parallax_deg < options.min_parallax_deg) return InitReason::kTooLittleParallax;
  return InitReason::kDone;
}

}  // namespace

TwoViewMotion estimateMotion(const Matches& matches,
                             const PinholeCamera& camera,
                             const TwoViewOptions& options,
                             std::uint64_t seed) {
  const ModelPair pair = fitModels(matches, options, seed);
  TwoViewMotion motion;
  motion.homography_score = pair.homography.score;
  motion.fundamental_score = pair.fundamental.score;
  const bool planar = options.model_choice == ModelChoice::kScore
                          ? pair.homographyShare() > options.homography_share
                          : pair.homography.inliers >= pair.fundamental.inliers;
  motion.model = planar ? TwoViewModel::kHomography : TwoViewModel::kFundamental;
  const ScoredModel& chosen = planar ? pair.homography : pair.fundamental;
  motion.inliers = chosen.inliers;
  if (chosen.inliers == 0) {
    motion.reason = InitReason::kTooFewPoints;
    return motion;
  }
  const std::vector<SE3> motions = planar ? decomposeHomography(chosen.matrix, camera)
                                          : decomposeFundamental(chosen.matrix, camera);
  for (const SE3& decomposed : motions) {
    const SE3 T_target_ref =
        refineMotion(decomposed, matches, chosen.inlier, camera, options.sigma);
    MotionHypothesis hypothesis =
        evaluateMotion(T_target_ref, matches, chosen.inlier, camera, options);
    if (hypothesis.good > motion.best.good) std::swap(hypothesis, motion.best);
    motion.second_good = std::max(motion.second_good, hypothesis.good);
  }
  motion.reason = judge(motion, options);
  return motion;
}

}  // namespace dsorb::init_orb
