// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/thesis/geometric_adjustment.h"

#include "init/orb/bundle/adjustment_solvers.h"
#include "init/orb/bundle/geometric_covariance.h"
#include "init/orb/bundle/reprojection_equations.h"
#include "init/orb/map/map_scale.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace dsorb::init_orb {
namespace {

constexpr int kMaxRounds = 10;  // of solving and removing corners

/// Adjusts a map and removes corners that do not fit.
class Adjustment {
 public:
  Adjustment(InitialMap& map, const PinholeCamera& camera, const GeometricOptions& options);

  /// @return iterations, or nullopt when the solver found no usable numbers
  std::optional<int> solve();
  /// Removes corners with a larger error than `limit` [px] in any frame, and corners behind a
  /// camera. @return their number
  int removeAbove(double limit);
  /// Drops removed corners and unused observations.
  void compact();

  [[nodiscard]] int remaining() const { return remaining_; }
  [[nodiscard]] int unseen() const { return unseen_; }
  /// Root mean square of one coordinate of the reprojection errors [px].
  [[nodiscard]] double residualRms() const;

 private:
  [[nodiscard]] bool counts(const Observation& observation) const {
    return kept_[static_cast<std::size_t>(observation.corner)] != 0 &&
           map_.frames[static_cast<std::size_t>(observation.frame)].T_cam_ref.has_value();
  }
  /// @return reprojection error [px]; nullopt when the point is not in front of the camera
  [[nodiscard]] std::optional<double> error(const Observation& observation) const;

  InitialMap& map_;
  const PinholeCamera& camera_;
  const GeometricOptions& options_;
  int remaining_ = 0;
  int unseen_ = 0;
  std::vector<char> kept_;  ///< by corner
};

Adjustment::Adjustment(InitialMap& map,
                       const PinholeCamera& camera,
                       const GeometricOptions& options)
    : map_(map), camera_(camera), options_(options), kept_(map.corners.size(), 0) {
  for (const Observation& observation : map.observations) {
    if (map.frames[static_cast<std::size_t>(observation.frame)].T_cam_ref) {
      kept_[static_cast<std::size_t>(observation.corner)] = 1;
    }
  }
  remaining_ = static_cast<int>(std::count(kept_.begin(), kept_.end(), 1));
  unseen_ = static_cast<int>(kept_.size()) - remaining_;
}

std::optional<int> Adjustment::solve() {
  return solveGeometry(map_, kept_, camera_, options_);
}

std::optional<double> Adjustment::error(const Observation& observation) const {
  const Corner& corner = map_.corners[static_cast<std::size_t>(observation.corner)];
  const auto projection = projectCorner(map_, camera_, observation);
  if (!projection || !(corner.inverse_depth > 0)) {
    return std::nullopt;
  }
  return (projection->pixel - observation.pixel).norm();
}

int Adjustment::removeAbove(double limit) {
  const int before = remaining_;
  for (const Observation& observation : map_.observations) {
    if (!counts(observation)) {
      continue;
    }
    const std::optional<double> distance = error(observation);
    if (!distance || !(*distance <= limit)) {
      kept_[static_cast<std::size_t>(observation.corner)] = 0;
      --remaining_;
    }
  }
  return before - remaining_;
}

double Adjustment::residualRms() const {
  double sum = 0;
  int count = 0;
  for (const Observation& observation : map_.observations) {
    if (counts(observation)) {
      const double distance = error(observation).value_or(0);
      sum += distance * distance;
      count += 2;
    }
  }
  return std::sqrt(sum / std::max(count, 1));
}

void Adjustment::compact() {
  std::vector<char> removed(kept_.size());
  std::transform(
      kept_.begin(), kept_.end(), removed.begin(), [](char kept) { return kept == 0 ? 1 : 0; });
  removeCorners(map_, removed);
  kept_.assign(map_.corners.size(), 1);
}

/// Severe outliers with a new solution after each removal, then normal ones.
/// @return false when the attempt fails
bool solveAndRemove(Adjustment& adjustment,
                    const GeometricOptions& options,
                    GeometricReport& report) {
  const auto solve = [&]() {
    const std::optional<int> iterations =
        adjustment.remaining() >= options.min_points ? adjustment.solve() : std::nullopt;
    report.rounds += 1;
    report.iterations += iterations.value_or(0);
    return iterations.has_value();
  };
  // No solver can start from a point behind a camera.
  report.removed_severe = adjustment.removeAbove(std::numeric_limits<double>::max());
  int removed = 0;
  do {
    if (!solve()) {
      return false;
    }
    removed = adjustment.removeAbove(options.severe_limit);
    report.removed_severe += removed;
  } while (removed > 0 && report.rounds < kMaxRounds);
  removed = adjustment.removeAbove(options.normal_limit);
  report.removed_normal = removed;
  while (removed > 0 && report.rounds < kMaxRounds) {
    if (!solve()) {
      return false;
    }
    removed = adjustment.removeAbove(options.normal_limit);
    report.removed_normal += removed;
  }
  return adjustment.remaining() >= options.min_points;
}

}  // namespace

GeometricReport adjustGeometry(InitialMap& map,
                               const PinholeCamera& camera,
                               const GeometricOptions& options) {
  GeometricReport report;
  Adjustment adjustment(map, camera, options);
  report.removed_unseen = adjustment.unseen();
  if (!solveAndRemove(adjustment, options, report)) {
    return report;
  }
  report.residual_rms = adjustment.residualRms();
  adjustment.compact();
  if (!normalizeCornerScale(map)) {
    return report;
  }
  report.variance_factor = setCovariances(map, camera, options);
  report.usable = std::isfinite(report.variance_factor);
  return report;
}

}  // namespace dsorb::init_orb
