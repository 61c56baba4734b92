// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/attempt.h"

#include "base/median.h"
#include "init/orb/stages.h"
#include "init/orb/start/essential_start.h"
#include "init/orb/thesis/two_view_start.h"
#include "init/result.h"

#include <cmath>
#include <utility>
#include <vector>

namespace dsorb::init_orb {
namespace {

/// Reconstruction of the published variants: two-view geometry by homography or fundamental matrix,
/// then adjustments of all frames.
/// @source [Gladkova], algorithm 1
Outcome<Reconstruction> reconstructAsGladkova(const ReferenceView& view,
                                              const AttemptContext& context) {
  using Made = Reconstruction;
  return startFromTwoViews(view, context)
      .then([&](Made made) { return adjustCorners(std::move(made), context); })
      .then([&](Made made) { return addSemiDense(std::move(made), view, context); })
      .then([&](Made made) { return adjustCorners(std::move(made), context); })
      .then([&](Made made) { return adjustImages(std::move(made), context); });
}

/// Reconstruction of `orb`: essential matrix, adjustment of a few frames, a gate, refined corners;
/// all other frames are posed in the end.
Attempt reconstruct(const ReferenceView& view, const AttemptContext& context) {
  using Made = Reconstruction;
  auto [start, summary] = startFromEssential(view, context);
  auto made = std::move(start)
                  .then([&](Made m) { return addSemiDense(std::move(m), view, context); })
                  .then([&](Made m) { return adjustImages(std::move(m), context); })
                  .then([&](Made m) { return poseOtherFrames(std::move(m), context); });
  return {std::move(made), summary};
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
  Attempt attempt = context.options.orb.motion == MotionMethod::kGladkova
                        ? Attempt{reconstructAsGladkova(view, context), {}}
                        : reconstruct(view, context);
  attempt.summary.reason = attempt.made.reason();
  if (attempt.made) {
    attempt.made->report.corners = static_cast<int>(attempt.made->map.corners.size());
    attempt.made->report.optical_flow = view.optical_flow;
  }
  return attempt;
}

InitializationResult toResult(Reconstruction made) {
  InitializationResult result;
  result.points = pointsOf(made.map);
  result.frames = std::move(made.map.frames);
  result.report = std::move(made.report);
  normalizeScale(result);
  result.report.median_relative_sigma = medianRelativeSigma(result.points);
  return result;
}

}  // namespace dsorb::init_orb
