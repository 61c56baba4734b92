// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/bundle/robust_adjustment.h"

#include "base/median.h"
#include "base/parallel.h"
#include "features/corner_tracks.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>

namespace dsorb::init_orb {
namespace {

constexpr double kTailShare = 0.9;
constexpr double kNormalTail = 2.4387;  // that quantile over the median of a normal |error|
constexpr double kFirstLimit = 6;       // least limit after the first solution [px]
/// Limit of an error, between kFirstLimit or kNormalLimit and kSevereLimit [robust standard
/// deviations].
constexpr double kLimitFactor = 4;
constexpr double kMinSigma = 1e-3;  // [px]; exact tracks of synthetic maps

bool isPosed(const InitialMap& map, const CornerObservation& observation) {
  return map.frames[observation.frame].T_cam_ref.has_value();
}

/// Median over frames with a pose.
double medianKnown(std::vector<double> errors) {
  errors.erase(
      std::remove_if(errors.begin(), errors.end(), [](double error) { return std::isnan(error); }),
      errors.end());
  return medianOf(std::move(errors));
}

/// Marks the corners with an error above a limit in any frame. @param errors one an observation
std::vector<char> cornersAbove(const InitialMap& map,
                               const std::vector<double>& errors,
                               double limit) {
  std::vector<char> above(map.corners.size(), 0);
  for (std::size_t i = 0; i < errors.size(); ++i) {
    if (errors[i] > limit) above[map.observations[i].corner] = 1;
  }
  return above;
}

/// Reprojection error of every observation, whitened but for sigma; infinite behind a camera, NaN
/// in frames without pose.
std::vector<double> reprojectionErrors(const InitialMap& map, const PinholeCamera& camera) {
  const auto error = [&](const CornerObservation& observation) {
    if (!isPosed(map, observation)) return std::numeric_limits<double>::quiet_NaN();
    const auto found = errorOf(map, camera, observation);
    return found ? found->value.norm() : std::numeric_limits<double>::infinity();
  };
  std::vector<double> errors(map.observations.size());
  forEachRange(errors.size(), kTaskGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) errors[i] = error(map.observations[i]);
  });
  return errors;
}

}  // namespace

std::optional<InitialMap> adjustOnce(InitialMap map,
                                     const PinholeCamera& camera,
                                     const GeometricOptions& options,
                                     const Stopping& stopping) {
  constexpr double kMax = std::numeric_limits<double>::max();
  removeCorners(map, cornersAbove(map, reprojectionErrors(map, camera), kMax));
  if (map.corners.empty() || !solveGeometry(map, camera, options, stopping)) return std::nullopt;
  return map;
}

std::optional<InitialMap> adjustRobustly(InitialMap map,
                                         const PinholeCamera& camera,
                                         const GeometricOptions& options) {
  for (const double least : {kFirstLimit, kNormalLimit}) {
    auto adjusted = adjustOnce(std::move(map), camera, options);
    if (!adjusted) return std::nullopt;
    map = std::move(*adjusted);
    const std::vector<double> errors = reprojectionErrors(map, camera);
    const double limit = std::clamp(
        kLimitFactor * kMadToSigma * medianKnown(errors), least, std::max(least, kSevereLimit));
    removeCorners(map, cornersAbove(map, errors, limit));
    if (static_cast<int>(map.corners.size()) < kMinCornersOfMotion) return std::nullopt;
  }
  return map;
}

double medianError(const InitialMap& map, const PinholeCamera& camera) {
  return medianKnown(reprojectionErrors(map, camera));
}

GeometricOptions adjustToNoise(InitialMap& map,
                               const PinholeCamera& camera,
                               const GeometricOptions& options,
                               int rounds) {
  GeometricOptions measured = options;
  for (int round = 0; round < rounds; ++round) {
    measured.sigma = std::max(kMinSigma, medianError(map, camera) / kMedianLength);
    if (!solveGeometry(map, camera, measured)) break;
  }
  return measured;
}

double tailExcess(const InitialMap& map, const PinholeCamera& camera) {
  std::vector<double> across;
  across.reserve(map.observations.size());
  for (const CornerObservation& observation : map.observations) {
    if (!isPosed(map, observation)) continue;
    const auto error = errorOf(map, camera, observation);
    const auto off = error ? error->across() : std::nullopt;
    if (off) across.push_back(*off);
  }
  const double median = medianInPlace(across);
  if (!(median > 0)) return 0;
  const double ratio = quantileInPlace(across, kTailShare) / (kNormalTail * median);
  return std::max(0.0, ratio * ratio - 1);
}

double flipToPositiveDepth(InitialMap& map) {
  const auto in_front =
      std::count_if(map.corners.begin(), map.corners.end(), [](const Corner& corner) {
        return corner.inverse_depth > 0;
      });
  const double share = static_cast<double>(in_front) / static_cast<double>(map.corners.size());
  if (share >= 0.5) return share;
  for (Corner& corner : map.corners) corner.inverse_depth = -corner.inverse_depth;
  for (PosedFrame& frame : map.frames) {
    if (frame.T_cam_ref) frame.T_cam_ref->setTranslation(-frame.T_cam_ref->translation());
  }
  return 1 - share;
}

}  // namespace dsorb::init_orb
