// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/attempt.h"

#include "dsorb/init/metric_scale.h"

#include "base/median.h"
#include "init/orb/bundle/corner_refinement.h"
#include "init/orb/bundle/map_assembly.h"
#include "init/orb/map/depth_lookup.h"
#include "init/orb/photometric/outlier_filter.h"
#include "init/orb/photometric/photometric_adjustment.h"
#include "init/orb/photometric/photometric_covariance.h"
#include "init/orb/semi_dense/dynamic_regions.h"
#include "init/orb/semi_dense/semi_dense_depth.h"
#include "init/orb/start/essential_start.h"
#include "init/orb/start/readout_profile.h"
#include "init/orb/start/start_gate.h"
#include "init/orb/two_view/stuck_tracks.h"
#include "init/result.h"

#include <cmath>
#include <optional>
#include <utility>
#include <vector>

namespace dsorb::init_orb {
namespace {

constexpr int kMinPoints = 50;  // semi-dense ones; fewer: the attempt fails

/// Known depths of the reference where the start is made of them.
KnownDepths knownDepths(const InitialMap& map, const InitReport& report) {
  if (!map.scaleKnown()) return {};
  const DepthLookup lookup(
      *map.frames.front().frame->priors()->depth, map.metres, report.depth_prior->inflation);
  return [lookup](const Eigen::Vector2f& pixel) { return lookup.at(pixel); };
}

/// Adds semi-dense inverse depths of the reference, leaving out regions that move by themselves.
Outcome<Reconstruction> addSemiDense(Reconstruction made,
                                     const ReferenceView& view,
                                     const AttemptContext& context) {
  InitialMap& map = made.map;
  InitReport& report = made.report;
  const OrbOptions& orb = context.options.orb;
  std::optional<DynamicRegions> moving;
  if (orb.remove_moving) {
    context.clock.time("moving", [&] { moving.emplace(map, view.tracks, context.camera); });
    report.dynamic_regions = {moving->contradicting(), moving->removeCorners(map)};
  }
  report.semi_dense = context.clock.time("semi_dense", [&] {
    return estimateSemiDenseDepth(
        map, context.camera, orb.semi_dense, context.seed(), knownDepths(map, report));
  });
  if (moving) report.dynamic_regions->removed += moving->removePoints(map);
  if (static_cast<int>(map.points.size()) < kMinPoints) {
    return InitReason::kTooFewPoints;
  }
  if (orb.semi_dense.max_points > 0) keepBestPoints(map, orb.semi_dense.max_points);
  return made;
}

/// Runs the photometric adjustment, the outlier filter and the second adjustment that the options
/// ask for.
Outcome<Reconstruction> adjustImages(Reconstruction made, const AttemptContext& context) {
  InitialMap& map = made.map;
  InitReport& report = made.report;
  const OrbOptions& orb = context.options.orb;
  if (!orb.photometric.enabled) return made;
  PhotometricProblem problem = context.clock.time(
      "photometric", [&] { return makeProblem(map, context.camera, orb.photometric); });
  const auto adjust = [&](const PhotometricOptions& options) {
    return context.clock.time(
        "photometric", [&] { return adjustPhotometry(map, problem, context.camera, options); });
  };
  PhotometricOptions first = orb.photometric;
  const bool filter = orb.outlier_rule != OutlierRule::kNone;
  if (filter && first.poses == PhotometricPoses::kCombined) first.poses = PhotometricPoses::kFixed;
  report.photometric = adjust(first);
  if (!report.photometric->usable) return InitReason::kPoorQuality;
  if (filter) {
    report.outliers = context.clock.time(
        "filter", [&] { return removeOutliers(map, problem, orb.outlier_rule); });
    report.second_photometric = adjust(orb.photometric);
    if (!report.second_photometric->usable) return InitReason::kPoorQuality;
  }
  const bool free = orb.photometric.poses == PhotometricPoses::kFree;
  auto known = context.clock.time("variances", [&] {
    return withPhotometricVariances(std::move(map), std::move(problem), free);
  });
  if (!known) return InitReason::kPoorQuality;
  made.map = std::move(*known);
  return made;
}

/// A map that has lost half of the tracks to moving regions and the filter is none to start with,
/// however sure the rest looks.
/// @source docs/experiments.md, "When to start"
Outcome<Reconstruction> refuseRemains(Reconstruction made) {
  if (!hasEnoughCorners(made.map, made.report.essential->tracks)) return InitReason::kPoorQuality;
  return made;
}

/// Poses the frames that had no part in the adjustments.
Outcome<Reconstruction> poseOtherFrames(Reconstruction made, const AttemptContext& context) {
  const OrbOptions& orb = context.options.orb;
  context.clock.time("pose", [&] {
    const std::vector<std::size_t> frames = poseOtherFrames(made.map, context.camera);
    refinePoses(made.map, context.camera, orb.geometric, frames);
  });
  return made;
}

/// Reconstruction of `orb`: essential matrix, adjustment of a few frames, a gate, refined corners;
/// all other frames are posed in the end.
Attempt reconstruct(ReferenceView seen, const AttemptContext& context) {
  using Made = Reconstruction;
  const std::vector<Eigen::Vector2f> stuck = context.clock.time(
      "stuck", [&] { return leaveOutStuck(seen.tracks, context.camera, context.seed()); });
  const Readout calibrated = readoutOf(*seen.frames.front());
  ReferenceView view = withGlobalShutter(seen, calibrated);
  EssentialStart start = startFromEssential(view, context);
  if (calibrated.sigma > 0 && start.summary.tried) {  // this frame is worth it
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
    start.made->report.essential->stuck_tracks = static_cast<int>(stuck.size());
  }
  auto made = std::move(start.made)
                  .then([&](Made m) { return addSemiDense(std::move(m), view, context); })
                  .then([&](Made m) { return adjustImages(std::move(m), context); })
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
    attempt.made->report.corners = static_cast<int>(attempt.made->map.corners.size());
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
  const bool contradicted = result.report.depth_prior && result.report.depth_prior->contradicted;
  if (priors != nullptr && priors->depth && priors->depth->metric && !contradicted) {
    result.metric = scaleFromDepth(result, *priors->depth);
  }
  if (!result.metric) result.metric = scaleFromDistances(result);
  result.report.median_relative_sigma = medianRelativeSigma(result.points);
  return result;
}

}  // namespace dsorb::init_orb
