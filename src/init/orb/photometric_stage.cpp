// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/photometric_stage.h"

#include "init/orb/photometric/outlier_filter.h"
#include "init/orb/photometric/photometric_adjustment.h"
#include "init/orb/photometric/photometric_covariance.h"

#include <optional>
#include <string>

namespace dsorb::init_orb {
namespace {

/// @return nullopt when the attempt fails
std::optional<PhotometricReport> adjustOnce(const AttemptContext& context,
                                            const std::string& name,
                                            PhotometricProblem& problem,
                                            Attempt& attempt) {
  const PhotometricReport report = context.clock.time("photometric", [&] {
    return adjustPhotometry(*attempt.map, problem, context.camera, context.options.orb.photometric);
  });
  auto& details = attempt.report.details;
  details.emplace_back(name + "_patches", report.patches);
  details.emplace_back(name + "_iterations", report.iterations);
  details.emplace_back(name + "_first_cost", report.first_cost);
  details.emplace_back(name + "_cost", report.cost);
  details.emplace_back(name + "_inside", report.inside_share);
  details.emplace_back(name + "_direction_sigmas", report.direction_sigmas);
  details.emplace_back(name + "_poses_moved", report.poses_moved ? 1 : 0);
  if (report.usable) return report;
  attempt.reason = InitReason::kPoorQuality;
  return std::nullopt;
}

}  // namespace

bool adjustImages(const AttemptContext& context, Attempt& attempt) {
  const OrbOptions& orb = context.options.orb;
  if (!orb.photometric.enabled) return true;
  PhotometricProblem problem = context.clock.time(
      "photometric", [&] { return makeProblem(*attempt.map, context.camera, orb.photometric); });
  std::optional<PhotometricReport> adjusted = adjustOnce(context, "photometric", problem, attempt);
  if (!adjusted) return false;
  bool poses_moved = adjusted->poses_moved;
  if (orb.outlier_rule != OutlierRule::kNone) {
    const OutlierReport filter = context.clock.time("filter", [&] {
      return removeOutliers(*attempt.map, problem, orb.photometric, orb.outlier_rule);
    });
    auto& details = attempt.report.details;
    details.emplace_back("filter_examined", filter.examined);
    details.emplace_back("filter_removed_corners", filter.removed_corners);
    details.emplace_back("filter_removed_points", filter.removed_points);
    details.emplace_back("filter_t_scale", filter.t_scale);
    adjusted = adjustOnce(context, "second_photometric", problem, attempt);
    if (!adjusted) return false;
    poses_moved = poses_moved || adjusted->poses_moved;
  }
  context.clock.time("variances", [&] {
    return setPhotometricVariances(*attempt.map, problem, orb.photometric, poses_moved);
  });
  return true;
}

}  // namespace dsorb::init_orb
