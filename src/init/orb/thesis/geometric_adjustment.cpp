// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/thesis/geometric_adjustment.h"

#include "init/orb/bundle/geometric_covariance.h"
#include "init/orb/bundle/reprojection_equations.h"
#include "init/orb/bundle/robust_adjustment.h"

#include <cmath>
#include <limits>
#include <utility>
#include <vector>

namespace dsorb::init_orb {
namespace {

constexpr int kMaxRounds = 10;  // of solving and removing corners

/// Removes the corners that no posed frame sees. @return their number
int removeUnseen(InitialMap& map) {
  std::vector<char> unseen(map.corners.size(), 1);
  for (const CornerObservation& observation : map.observations) {
    if (map.frames[observation.frame].T_cam_ref) unseen[observation.corner] = 0;
  }
  return removeCorners(map, unseen);
}

/// Removes corners with a larger error than `limit` [px] in any frame, and corners behind a camera.
/// @return their number
int removeAbove(InitialMap& map, const PinholeCamera& camera, double limit) {
  std::vector<char> removed = cornersAbove(map, reprojectionErrors(map, camera), limit);
  for (std::size_t i = 0; i < removed.size(); ++i) {
    if (!(map.corners[i].inverse_depth > 0)) removed[i] = 1;
  }
  return removeCorners(map, removed);
}

/// Root mean square of one coordinate of the reprojection errors [px].
double residualRms(const InitialMap& map, const PinholeCamera& camera) {
  double sum = 0;
  int count = 0;
  for (const double error : reprojectionErrors(map, camera)) {
    if (!std::isfinite(error)) continue;
    sum += error * error;
    count += 2;
  }
  return std::sqrt(sum / std::max(count, 1));
}

/// Removes severe outliers with a new solution after each removal, then normal ones. The report is
/// usable where enough corners are left.
GeometricAdjustment solveAndRemove(GeometricAdjustment adjusted,
                                   const PinholeCamera& camera,
                                   const GeometricOptions& options) {
  InitialMap& map = adjusted.map;
  GeometricReport& report = adjusted.report;
  const auto enough = [&] { return static_cast<int>(map.corners.size()) >= kMinAdjusted; };
  const auto solve = [&] {
    const std::optional<int> iterations =
        enough() ? solveGeometry(map, camera, options) : std::nullopt;
    report.rounds += 1;
    report.iterations += iterations.value_or(0);
    return iterations.has_value();
  };
  // No solver can start from a point behind a camera.
  report.removed_severe = removeAbove(map, camera, std::numeric_limits<double>::max());
  int removed = 0;
  do {
    if (!solve()) return adjusted;
    removed = removeAbove(map, camera, kSevereLimit);
    report.removed_severe += removed;
  } while (removed > 0 && report.rounds < kMaxRounds);
  removed = removeAbove(map, camera, kNormalLimit);
  report.removed_normal = removed;
  while (removed > 0 && report.rounds < kMaxRounds) {
    if (!solve()) return adjusted;
    removed = removeAbove(map, camera, kNormalLimit);
    report.removed_normal += removed;
  }
  report.usable = enough();
  return adjusted;
}

}  // namespace

GeometricAdjustment adjustGeometry(InitialMap map,
                                   const PinholeCamera& camera,
                                   const GeometricOptions& options) {
  GeometricReport begun;
  begun.removed_unseen = removeUnseen(map);
  GeometricAdjustment adjusted = solveAndRemove({std::move(map), begun}, camera, options);
  GeometricReport& report = adjusted.report;
  if (!report.usable) return adjusted;
  report.residual_rms = residualRms(adjusted.map, camera);
  report.usable = normalizeCornerScale(adjusted.map);
  if (!report.usable) return adjusted;
  report.variance_factor = setCovariances(adjusted.map, camera, options);
  report.usable = std::isfinite(report.variance_factor);
  return adjusted;
}

}  // namespace dsorb::init_orb
