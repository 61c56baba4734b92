// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/start/readout_profile.h"

#include "estimate/rolling_shutter.h"
#include "features/middle_rows.h"
#include "init/orb/start/motion_candidates.h"
#include "init/orb/start/start_gate.h"
#include "two_view/essential_motion.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>

namespace dsorb::init_orb {
namespace {

constexpr std::size_t kNodes = 5;  // the calibrated readout is the middle one
constexpr double kReach = 1.5;  // outermost nodes [standard deviations of the calibrated readout]
/// What an estimate must gain in the logarithm of the posterior, as at two standard deviations:
/// many cameras are just as calibrated, with a global shutter.
constexpr double kMinGain = 2;

/// Negative logarithm of the posterior of a readout, but for a constant. The noise is not known, so
/// that its likelihood is a power of the mean cost; the errors of a cell of the image count as one.
double negativeLogPosterior(const ReferenceView& seen,
                            const Readout& readout,
                            const AttemptContext& context) {
  constexpr double kNever = std::numeric_limits<double>::infinity();
  const ReferenceView view = withGlobalShutter(seen, readout);
  const Matches matches = view.tracks.matchesTo(view.tracks.frames() - 1);
  const auto motion = estimateEssentialMotion(matches, context.camera, context.seed());
  if (!motion) return kNever;
  const auto candidate = makeCandidate(view, *motion, context);
  if (!candidate || !(candidate->cost > 0)) return kNever;
  const Readout calibrated = readoutOf(*seen.frames.front());
  const double deviation = (readout.seconds - calibrated.seconds) / calibrated.sigma;
  return 0.5 * occupiedCells(candidate->map, context.camera) * std::log(candidate->cost) +
         0.5 * deviation * deviation;
}

}  // namespace

ReferenceView withGlobalShutter(ReferenceView seen, const Readout& readout) {
  const Frame& reference = *seen.frames.front();
  if (!isRolling(reference)) return seen;
  seen.readout = readout;
  seen.tracks = atMiddleRows(
      std::move(seen.tracks), seen.frames, readout.seconds - readoutOf(reference).seconds);
  return seen;
}

Readout profileReadout(const ReferenceView& seen, const AttemptContext& context) {
  const Readout calibrated = readoutOf(*seen.frames.front());
  const double step = 2 * kReach * calibrated.sigma / (kNodes - 1);
  const auto node_at = [&](std::size_t i) {
    return Readout{calibrated.seconds - kReach * calibrated.sigma + static_cast<double>(i) * step,
                   calibrated.sigma};
  };
  std::array<double, kNodes> profile{};
  for (std::size_t i = 0; i < kNodes; ++i) {
    profile[i] = negativeLogPosterior(seen, node_at(i), context);
  }
  const auto least =
      static_cast<std::size_t>(std::min_element(profile.begin(), profile.end()) - profile.begin());
  if (!std::isfinite(profile[least])) return calibrated;
  const std::size_t middle = std::clamp<std::size_t>(least, 1, kNodes - 2);
  const double slope = (profile[middle + 1] - profile[middle - 1]) / (2 * step);
  const double curvature =
      (profile[middle + 1] - 2 * profile[middle] + profile[middle - 1]) / (step * step);
  if (!(curvature > 0) || !std::isfinite(curvature)) {
    return profile[kNodes / 2] - profile[least] < kMinGain ? calibrated : node_at(least);
  }
  const double move = std::clamp(-slope / curvature, -step, step);
  const double lowest = profile[middle] + move * (slope + 0.5 * move * curvature);
  if (profile[kNodes / 2] - lowest < kMinGain) return calibrated;
  return {node_at(middle).seconds + move, 1 / std::sqrt(curvature)};
}

}  // namespace dsorb::init_orb
