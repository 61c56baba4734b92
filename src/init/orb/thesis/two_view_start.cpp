// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/thesis/two_view_start.h"

#include "init/orb/bundle/map_assembly.h"
#include "init/orb/thesis/geometric_adjustment.h"
#include "init/orb/thesis/two_view_motion.h"
#include "init/orb/two_view/rotation_only.h"

namespace dsorb::init_orb {

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
  const GeometricReport adjusted = context.clock.time("geometric", [&] {
    return adjustGeometry(made.map, context.camera, context.options.orb.geometric);
  });
  made.report.residual_rms = adjusted.residual_rms;
  made.report.two_view->removed_severe += adjusted.removed_severe;
  made.report.two_view->removed_normal += adjusted.removed_normal;
  if (!adjusted.usable) return InitReason::kPoorQuality;
  return made;
}

}  // namespace dsorb::init_orb
