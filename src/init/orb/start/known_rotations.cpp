// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/start/known_rotations.h"

#include "dsorb/image/frame_priors.h"

#include "init/orb/bundle/reprojection_equations.h"
#include "init/orb/bundle/robust_adjustment.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace dsorb::init_orb {
namespace {

// Median length of a two-dimensional vector whose coordinates have standard deviation 1.
constexpr double kMedianLength = 1.1774;
constexpr double kMinNoise = 0.05;  // of the tracks [px]
/// Standard deviations above its mean at which the chi-square of a contradiction refuses.
constexpr double kContradiction = 5;

/// Rotation from the reference to a frame, its errors added up.
struct Turned {
  SE3 R_cam_ref;
  double variance = 0;
};

/// By frame; none where the chain of priors does not reach the reference.
std::vector<std::optional<Turned>> turnsOf(const std::vector<FramePtr>& frames) {
  std::vector<std::optional<Turned>> turns(frames.size());
  turns.front() = Turned();
  for (std::size_t k = 1; k < frames.size(); ++k) {
    if (frames[k] == nullptr) continue;  // motion without images, as tests have it
    const FramePriors* priors = frames[k]->priors();
    if (priors == nullptr || !priors->rotation) continue;
    const RotationPrior& prior = *priors->rotation;
    for (std::size_t j = 0; j < k; ++j) {
      if (frames[j]->id() != prior.since || !turns[j]) continue;
      const SE3 turn(prior.R_frame_since, Eigen::Vector3d::Zero());
      turns[k] = Turned{turn * turns[j]->R_cam_ref, turns[j]->variance + prior.sigma * prior.sigma};
    }
  }
  return turns;
}

}  // namespace

std::vector<KnownRotation> knownRotations(const std::vector<FramePtr>& all,
                                          const std::vector<std::size_t>& frames) {
  const std::vector<std::optional<Turned>> turns = turnsOf(all);
  std::vector<KnownRotation> known;
  std::size_t from = 0;
  for (const std::size_t to : frames) {
    if (to == 0 || !turns[to]) continue;
    const double variance = turns[to]->variance - turns[from]->variance;
    if (!(variance > 0)) continue;  // known since a frame before `from` only
    known.push_back({from, to, turns[to]->R_cam_ref * turns[from]->R_cam_ref.inverse(), variance});
    from = to;
  }
  return known;
}

std::optional<bool> adjustWithRotations(InitialMap& map,
                                        std::vector<KnownRotation> rotations,
                                        const PinholeCamera& camera,
                                        const GeometricOptions& options) {
  if (rotations.empty()) return std::nullopt;
  GeometricOptions measured = options;
  measured.sigma = std::max(kMinNoise, medianError(map, camera) / kMedianLength);
  InitialMap free = map;
  if (!adjustOnce(free, camera, measured)) return false;
  InitialMap bound = free;
  bound.rotations = std::move(rotations);
  if (!adjustOnce(bound, camera, measured)) return false;
  const double freedom = 3 * static_cast<double>(bound.rotations.size());
  // With the rotations' own cost this is twice the drop of the logarithm of the likelihood.
  const auto with = reprojectionCost(bound, camera, measured);
  const auto without = reprojectionCost(free, camera, measured);
  if (!with || !without) return false;
  if (2 * (*with - *without) > freedom + kContradiction * std::sqrt(2 * freedom)) return false;
  map = std::move(bound);
  return true;
}

}  // namespace dsorb::init_orb
