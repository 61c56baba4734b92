// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/thesis/report_motion.h"

#include "init/orb/bundle/map_assembly.h"
#include "init/orb/thesis/geometric_adjustment.h"
#include "init/orb/thesis/two_view_motion.h"
#include "init/orb/two_view/rotation_only.h"

#include <algorithm>
#include <string>

namespace dsorb::init_orb {
namespace {

void describeMotion(const TwoViewMotion& motion, std::size_t matches, InitReport& report) {
  report.model = motion.model == TwoViewModel::kHomography ? "homography" : "fundamental";
  report.inlier_ratio = static_cast<double>(motion.inliers) / static_cast<double>(matches);
  report.details.emplace_back("tracks", static_cast<double>(matches));
  report.details.emplace_back("score_homography", motion.homography_score);
  report.details.emplace_back("score_fundamental", motion.fundamental_score);
  report.details.emplace_back("model_inliers", motion.inliers);
  report.details.emplace_back("good_points", motion.best.good);
  report.details.emplace_back("good_points_of_second_motion", motion.second_good);
  report.details.emplace_back("ranked_parallax_deg", motion.best.parallax_deg);
}

/// Adds to a detail that several stages count.
void count(InitReport& report, const std::string& name, double value) {
  const auto same_name = [&](const auto& detail) { return detail.first == name; };
  const auto known = std::find_if(report.details.begin(), report.details.end(), same_name);
  if (known != report.details.end()) {
    known->second += value;
  } else {
    report.details.emplace_back(name, value);
  }
}

}  // namespace

bool estimateReportMotion(const ReferenceView& view,
                          const AttemptContext& context,
                          Attempt& attempt) {
  const Matches matches = view.tracks.matchesTo(view.tracks.frames() - 1);
  attempt.report.median_parallax_deg =
      context.clock.time("two_view", [&] { return rotationResidualDeg(matches, context.camera); });
  if (attempt.report.median_parallax_deg < kMinRotationResidualDeg) {
    attempt.reason = InitReason::kTooLittleParallax;
    return false;
  }
  const TwoViewMotion motion = context.clock.time("two_view", [&] {
    return estimateMotion(
        matches, context.camera, context.options.orb.model_choice, context.seed());
  });
  attempt.reason = motion.reason;
  if (motion.reason != InitReason::kDone) return false;
  describeMotion(motion, matches.size(), attempt.report);
  attempt.map = makeInitialMap(view.frames, view.tracks, motion.best);
  context.clock.time("pose",
                     [&] { poseFramesBetween(*attempt.map, context.camera, kCornerSigma); });
  return adjustCorners(context, attempt);
}

bool adjustCorners(const AttemptContext& context, Attempt& attempt) {
  const GeometricReport adjusted = context.clock.time("geometric", [&] {
    return adjustGeometry(*attempt.map, context.camera, context.options.orb.geometric);
  });
  attempt.report.residual_rms = adjusted.residual_rms;
  count(attempt.report, "removed_severe", adjusted.removed_severe);
  count(attempt.report, "removed_normal", adjusted.removed_normal);
  if (!adjusted.usable) attempt.reason = InitReason::kPoorQuality;
  return adjusted.usable;
}

}  // namespace dsorb::init_orb
