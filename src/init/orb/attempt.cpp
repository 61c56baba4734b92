// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/attempt.h"

#include "dsorb/init/metric_scale.h"

#include "base/median.h"
#include "init/orb/bundle/corner_refinement.h"
#include "init/orb/bundle/map_assembly.h"
#include "init/orb/dynamic_regions.h"
#include "init/orb/first_window.h"
#include "init/orb/start/essential_start.h"
#include "init/orb/start/readout_profile.h"
#include "init/orb/start/start_gate.h"
#include "init/result.h"
#include "two_view/edge_tracks.h"
#include "two_view/stuck_tracks.h"

#include <cmath>
#include <optional>
#include <utility>
#include <vector>

namespace dsorb::init_orb {
namespace {

/// Fills the start up with points, leaving out regions that contradict the motion.
Outcome<Reconstruction> addPoints(Reconstruction made,
                                  const ReferenceView& view,
                                  const AttemptContext& context) {
  if (context.options.skip.has(Mechanism::kDynamic)) {
    return fillFirstWindow(std::move(made), context);
  }
  std::optional<DynamicRegions> dynamic;
  context.clock.time("dynamic", [&] { dynamic.emplace(made.map, view.tracks, context.camera); });
  const int corners = dynamic->removeCorners(made.map);
  auto filled = fillFirstWindow(std::move(made), context);
  if (!filled) return filled;
  filled->report.add("contradicting_tracks", dynamic->contradicting());
  filled->report.add("removed_dynamic", corners + dynamic->removePoints(filled->map));
  return filled;
}

/// A map that has lost half of its tracks to dynamic regions and to neighbours that contradict them
/// is none to start with, however sure the rest looks.
Outcome<Reconstruction> refuseRemains(Reconstruction made) {
  if (!hasEnoughCorners(made.map, made.live_tracks)) return InitReason::kPoorQuality;
  return made;
}

/// Poses the frames that had no part in the adjustments.
Outcome<Reconstruction> poseOtherFrames(Reconstruction made, const AttemptContext& context) {
  const OrbOptions& orb = context.options.orb;
  context.clock.time("pose", [&] {
    const std::vector<std::size_t> frames = poseOtherFrames(made.map, context.camera);
    if (!context.options.skip.has(Mechanism::kFramesBetween)) {
      refinePoses(made.map, context.camera, orb.geometric, frames);
    }
  });
  return made;
}

/// Reconstruction of `orb`: essential matrix, adjustment of a few frames, a gate, refined corners;
/// all other frames are posed in the end.
Attempt reconstruct(ReferenceView seen, const AttemptContext& context) {
  using Made = Reconstruction;
  const Skips& skip = context.options.skip;
  std::vector<Eigen::Vector2f> stuck;
  if (!skip.has(Mechanism::kStuck)) {
    stuck = context.clock.time(
        "stuck", [&] { return leaveOutStuck(seen.tracks, context.camera, context.seed()); });
  }
  if (!skip.has(Mechanism::kEdges)) leaveOutEdges(seen.frames.front()->level(0), seen.tracks);
  const Readout calibrated = readoutOf(*seen.frames.front());
  ReferenceView view = withGlobalShutter(seen, calibrated);
  EssentialStart start = startFromEssential(view, context);
  if (calibrated.sigma > 0 && start.summary.tried &&
      !skip.has(Mechanism::kReadoutProfile)) {  // this frame is worth it
    const Readout found =
        context.clock.time("readout", [&] { return profileReadout(seen, context); });
    if (found.seconds != calibrated.seconds) {
      view = withGlobalShutter(seen, found);
      view.last = {};
      start = startFromEssential(view, context);
    }
  }
  if (start.made) {
    start.made->map.stuck = stuck;
    start.made->report.add("stuck_tracks", static_cast<double>(stuck.size()));
  }
  auto made = std::move(start.made)
                  .then([&](Made m) { return addPoints(std::move(m), view, context); })
                  .then(refuseRemains)
                  .then([&](Made m) { return poseOtherFrames(std::move(m), context); });
  return {std::move(made), start.summary, start.motion};
}

double medianRelativeSigma(const std::vector<InitPoint>& points) {
  std::vector<double> sigmas;
  sigmas.reserve(points.size());
  for (const InitPoint& point : points) {
    sigmas.push_back(std::sqrt(point.variance) / point.inverse_depth);
  }
  return medianOf(std::move(sigmas));
}

}  // namespace

Attempt attemptFrom(const ReferenceView& view, const AttemptContext& context) {
  Attempt attempt = reconstruct(view, context);
  attempt.summary.reason = attempt.made.reason();
  if (attempt.made) {
    attempt.made->report.add("corners", static_cast<double>(attempt.made->map.corners.size()));
  }
  return attempt;
}

InitializationResult toResult(Reconstruction made) {
  InitializationResult result;
  result.points = pointsOf(made.map);
  result.frames = std::move(made.map.frames);
  result.report = std::move(made.report);
  result.readout = made.map.readout;
  result.stuck = std::move(made.map.stuck);
  normalizeScale(result);
  const FramePriors* priors = result.frames.front().frame->priors();
  const bool contradicted = made.depth_prior && made.depth_prior->contradicted;
  if (priors != nullptr && priors->depth && priors->depth->metric && !contradicted) {
    result.metric = scaleFromDepth(result, *priors->depth);
  }
  if (!result.metric) result.metric = scaleFromDistances(result);
  result.report.median_relative_sigma = medianRelativeSigma(result.points);
  return result;
}

}  // namespace dsorb::init_orb
