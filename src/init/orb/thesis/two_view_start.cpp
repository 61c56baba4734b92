// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/thesis/two_view_start.h"

#include "init/orb/bundle/map_assembly.h"
#include "init/orb/thesis/geometric_adjustment.h"
#include "init/orb/two_view/motion_refinement.h"
#include "init/orb/two_view/rotation_only.h"

#include <algorithm>
#include <utility>
#include <vector>

namespace dsorb::init_orb {
namespace {

// Gates of the thesis.
constexpr double kHomographyShare = 0.4;  // homography above it; [Gladkova], eq. (1)
constexpr int kMinTriangulated = 50;      // good points of the best motion
constexpr double kMinGoodShare = 0.9;     // good points of the best motion, of the inliers
constexpr double kMaxSecondShare = 0.7;   // good points of the second motion, of the best's
constexpr double kMinParallaxDeg = 1;     // of the point of evaluateMotion()'s rank

InitReason judge(const TwoViewMotion& motion) {
  const int good = motion.best.good;
  if (motion.inliers < kMinTriangulated) return InitReason::kTooFewPoints;
  const double needed =
      std::max(kMinGoodShare * motion.inliers, static_cast<double>(kMinTriangulated));
  if (good < needed) return InitReason::kPoorQuality;
  if (motion.second_good > kMaxSecondShare * good) return InitReason::kDegenerateMotion;
  if (motion.best.parallax_deg < kMinParallaxDeg) return InitReason::kTooLittleParallax;
  return InitReason::kDone;
}

}  // namespace

TwoViewMotion estimateMotion(const Matches& matches,
                             const PinholeCamera& camera,
                             ModelChoice choice,
                             std::uint64_t seed) {
  const ModelPair pair = fitModels(matches, seed);
  TwoViewMotion motion;
  motion.homography_score = pair.homography.score;
  motion.fundamental_score = pair.fundamental.score;
  const bool planar = choice == ModelChoice::kScore
                          ? pair.homographyShare() > kHomographyShare
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
    const SE3 T_cur_ref = refineMotion(decomposed, matches, chosen.inlier, camera, kCornerSigma);
    MotionHypothesis hypothesis = evaluateMotion(T_cur_ref, matches, chosen.inlier, camera);
    if (hypothesis.good > motion.best.good) std::swap(hypothesis, motion.best);
    motion.second_good = std::max(motion.second_good, hypothesis.good);
  }
  motion.reason = judge(motion);
  return motion;
}

Outcome<Reconstruction> startFromTwoViews(const ReferenceView& view,
                                          const AttemptContext& context) {
  const Matches matches = view.tracks.matchesTo(view.tracks.frames() - 1);
  Reconstruction made;
  made.report.median_parallax_deg =
      context.clock.time("two_view", [&] { return rotationResidualDeg(matches, context.camera); });
  if (made.report.median_parallax_deg < kMinRotationResidualDeg) {
    return InitReason::kTooLittleParallax;
  }
  const TwoViewMotion motion = context.clock.time("two_view", [&] {
    return estimateMotion(
        matches, context.camera, context.options.orb.model_choice, context.seed());
  });
  if (motion.reason != InitReason::kDone) return motion.reason;
  made.report.model = motion.model == TwoViewModel::kHomography ? "homography" : "fundamental";
  made.report.inlier_ratio =
      static_cast<double>(motion.inliers) / static_cast<double>(matches.size());
  made.report.two_view = {static_cast<int>(matches.size()),
                          motion.homography_score,
                          motion.fundamental_score,
                          motion.inliers,
                          motion.best.good,
                          motion.second_good,
                          motion.best.parallax_deg,
                          0,
                          0};
  made.map = makeInitialMap(view.frames, view.tracks, motion.best);
  context.clock.time("pose", [&] { poseFramesBetween(made.map, context.camera, kCornerSigma); });
  return made;
}

Outcome<Reconstruction> adjustCorners(Reconstruction made, const AttemptContext& context) {
  GeometricAdjustment adjusted = context.clock.time("geometric", [&] {
    return adjustGeometry(std::move(made.map), context.camera, context.options.orb.geometric);
  });
  if (!adjusted.report.usable) return InitReason::kPoorQuality;
  made.map = std::move(adjusted.map);
  made.report.residual_rms = adjusted.report.residual_rms;
  made.report.two_view->removed_severe += adjusted.report.removed_severe;
  made.report.two_view->removed_normal += adjusted.report.removed_normal;
  return made;
}

}  // namespace dsorb::init_orb
