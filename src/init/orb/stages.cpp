// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/stages.h"

#include "init/orb/bundle/corner_polish.h"
#include "init/orb/bundle/map_assembly.h"
#include "init/orb/photometric/outlier_filter.h"
#include "init/orb/photometric/photometric_adjustment.h"
#include "init/orb/photometric/photometric_covariance.h"
#include "init/orb/semi_dense/dynamic_regions.h"
#include "init/orb/semi_dense/semi_dense_depth.h"

#include <optional>

namespace dsorb::init_orb {
namespace {

constexpr int kMinPoints = 50;  // semi-dense ones; fewer: the attempt fails

}  // namespace

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
    return estimateSemiDenseDepth(map, context.camera, orb.semi_dense, context.seed());
  });
  if (moving) report.dynamic_regions->removed += moving->removePoints(map);
  if (static_cast<int>(map.points.size()) < kMinPoints) {
    return InitReason::kTooFewPoints;
  }
  if (orb.semi_dense.max_points > 0) keepBestPoints(map, orb.semi_dense.max_points);
  return made;
}

Outcome<Reconstruction> adjustImages(Reconstruction made, const AttemptContext& context) {
  InitialMap& map = made.map;
  InitReport& report = made.report;
  const OrbOptions& orb = context.options.orb;
  if (!orb.photometric.enabled) return made;
  PhotometricProblem problem = context.clock.time(
      "photometric", [&] { return makeProblem(map, context.camera, orb.photometric); });
  const auto adjust = [&] {
    return context.clock.time("photometric", [&] {
      return adjustPhotometry(map, problem, context.camera, orb.photometric);
    });
  };
  report.photometric = adjust();
  if (!report.photometric->usable) return InitReason::kPoorQuality;
  bool poses_moved = report.photometric->poses_moved;
  if (orb.outlier_rule != OutlierRule::kNone) {
    report.outliers = context.clock.time(
        "filter", [&] { return removeOutliers(map, problem, orb.photometric, orb.outlier_rule); });
    report.second_photometric = adjust();
    if (!report.second_photometric->usable) return InitReason::kPoorQuality;
    poses_moved = poses_moved || report.second_photometric->poses_moved;
  }
  context.clock.time("variances", [&] {
    return setPhotometricVariances(map, problem, orb.photometric, poses_moved);
  });
  return made;
}

Outcome<Reconstruction> poseOtherFrames(Reconstruction made, const AttemptContext& context) {
  const OrbOptions& orb = context.options.orb;
  context.clock.time("pose", [&] {
    const std::vector<int> frames = poseOtherFrames(made.map, context.camera);
    refinePoses(made.map, context.camera, orb.geometric, orb.polish_rounds, frames);
  });
  return made;
}

}  // namespace dsorb::init_orb
