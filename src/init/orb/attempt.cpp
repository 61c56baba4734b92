// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/attempt.h"

#include "init/orb/bundle/corner_polish.h"
#include "init/orb/bundle/map_assembly.h"
#include "init/orb/photometric_stage.h"
#include "init/orb/semi_dense/moving_parts.h"
#include "init/orb/semi_dense/semi_dense_depth.h"
#include "init/orb/start/informed_motion.h"
#include "init/orb/thesis/geometric_adjustment.h"
#include "init/orb/thesis/report_motion.h"

#include <utility>
#include <vector>

namespace dsorb::init_orb {
namespace {

constexpr int kMinPoints = 50;  // semi-dense ones; fewer: the attempt fails

void densify(const AttemptContext& context, Attempt& attempt) {
  const SemiDenseReport report = context.clock.time("semi_dense", [&] {
    return estimateSemiDenseDepth(
        *attempt.map, context.camera, context.options.orb.semi_dense, context.seed());
  });
  attempt.report.details.emplace_back("semi_dense_candidates", report.candidates);
  attempt.report.details.emplace_back("semi_dense_points", report.points);
}

/// Semi-dense depths for the corners' map, without what moves by itself.
/// @return whether enough came of it
bool addSemiDense(const ReferenceView& view, const AttemptContext& context, Attempt& attempt) {
  const OrbOptions& orb = context.options.orb;
  if (orb.remove_moving) {
    const MovingParts moving = context.clock.time(
        "moving", [&] { return MovingParts(*attempt.map, view.tracks, context.camera); });
    int removed = moving.removeCorners(*attempt.map);
    densify(context, attempt);
    removed += moving.removePoints(*attempt.map);
    attempt.report.details.emplace_back("contradicting_tracks", moving.contradicting());
    attempt.report.details.emplace_back("removed_moving", removed);
  } else {
    densify(context, attempt);
  }
  if (static_cast<int>(attempt.map->points.size()) >= kMinPoints) {
    if (orb.semi_dense.max_points > 0) keepBestPoints(*attempt.map, orb.semi_dense.max_points);
    return true;
  }
  attempt.reason = InitReason::kTooFewPoints;
  return false;
}

/// @return whether the attempt's map can be handed over
bool mapFrom(const ReferenceView& view, const AttemptContext& context, Attempt& attempt) {
  if (context.options.orb.motion == MotionMethod::kGladkova) {
    return estimateReportMotion(view, context, attempt) && addSemiDense(view, context, attempt) &&
           adjustCorners(context, attempt) && adjustImages(context, attempt);
  }
  const bool usable = estimateInformedMotion(view, context, attempt) &&
                      addSemiDense(view, context, attempt) && adjustImages(context, attempt);
  if (!usable) return false;
  context.clock.time("pose", [&] {
    const std::vector<int> frames = poseOtherFrames(*attempt.map, context.camera);
    const OrbOptions& orb = context.options.orb;
    polishPoses(*attempt.map, context.camera, orb.geometric, orb.polish_rounds, frames);
  });
  return true;
}

}  // namespace

Attempt attemptFrom(const ReferenceView& view, const AttemptContext& context) {
  Attempt attempt;
  if (!mapFrom(view, context, attempt)) {
    attempt.map.reset();
    return attempt;
  }
  attempt.reason = InitReason::kDone;
  attempt.report.details.emplace_back("corners", static_cast<double>(attempt.map->corners.size()));
  return attempt;
}

InitializationResult toResult(Attempt attempt) {
  InitializationResult result = toResult(*attempt.map);
  InitReport& report = result.report;
  report.model = std::move(attempt.report.model);
  report.median_parallax_deg = attempt.report.median_parallax_deg;
  report.inlier_ratio = attempt.report.inlier_ratio;
  report.residual_rms = attempt.report.residual_rms;
  report.details = std::move(attempt.report.details);
  return result;
}

}  // namespace dsorb::init_orb
