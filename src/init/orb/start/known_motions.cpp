// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/start/known_motions.h"

#include "dsorb/geometry/se3.h"
#include "dsorb/image/frame_priors.h"

#include "base/median.h"
#include "estimate/rolling_shutter.h"
#include "init/orb/bundle/frame_motions.h"
#include "init/orb/bundle/reprojection_equations.h"
#include "init/orb/bundle/robust_adjustment.h"

#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <utility>

namespace dsorb::init_orb {
namespace {

constexpr double kMinNoise = 0.05;  // of the tracks [px]
/// Standard deviations above its mean at which the chi-square of a contradiction refuses.
constexpr double kContradiction = 5;

/// Frame that a prior refers to; none where it did not come before.
std::optional<std::size_t> earlier(const std::vector<FramePtr>& all, std::size_t k, FrameId since) {
  for (std::size_t j = k; j-- > 0;) {
    if (all[j] != nullptr && all[j]->id() == since) return j;
  }
  return std::nullopt;
}

/// Information of the differences of translation and rotation from the covariance of
/// exp(xi) * T: T moves its translation t by rho + w x t.
void setInformation(const Matrix6d& covariance, KnownMotion& known) {
  if (!known.has_translation) {
    const Eigen::Matrix3d of_rotation = covariance.bottomRightCorner<3, 3>();
    known.information.bottomRightCorner<3, 3>() = of_rotation.inverse();
    return;
  }
  Matrix6d J = Matrix6d::Identity();
  J.topRightCorner<3, 3>() = -hat(known.T_to_from.translation());
  const Eigen::Matrix<double, 6, 6> of_error = J * covariance * J.transpose();
  known.information = of_error.inverse();
}

/// Follows the priors back from a frame to the next one that is wanted.
std::optional<KnownMotion> chainTo(std::size_t to,
                                   const std::vector<FramePtr>& all,
                                   const std::vector<char>& wanted) {
  KnownMotion known;
  known.to = to;
  known.from = to;
  known.has_translation = true;
  Matrix6d covariance = Matrix6d::Zero();
  do {
    if (all[known.from] == nullptr) return std::nullopt;  // motion without images, as tests have it
    const FramePriors* priors = all[known.from]->priors();
    if (priors == nullptr || !priors->pose) return std::nullopt;
    const PosePrior& prior = *priors->pose;
    const auto before = earlier(all, known.from, prior.since);
    if (!before) return std::nullopt;
    const Matrix6d adjoint = known.T_to_from.adjoint();
    covariance += adjoint * prior.covariance * adjoint.transpose();
    known.T_to_from = known.T_to_from * prior.T_frame_since;
    known.has_translation = known.has_translation && prior.has_translation;
    known.from = *before;
  } while (wanted[known.from] == 0);
  setInformation(covariance, known);
  return known;
}

double noiseOf(const InitialMap& map, const PinholeCamera& camera) {
  return std::max(kMinNoise, medianError(map, camera) / kMedianLength);
}

/// The map with motions of its rows; nothing where it tells none.
std::optional<InitialMap> withRowMotions(InitialMap map,
                                         const PinholeCamera& camera,
                                         const GeometricOptions& options) {
  auto adjusted = adjustOnce(std::move(map), camera, options);
  if (!adjusted) return std::nullopt;
  estimateMotions(*adjusted, camera);
  return adjustOnce(std::move(*adjusted), camera, options);
}

/// Adjusts a map once more, bound by what is known of the motions; nothing where that contradicts
/// its images.
std::optional<InitialMap> boundByMotions(InitialMap map,
                                         const std::vector<KnownMotion>& motions,
                                         const PinholeCamera& camera,
                                         const GeometricOptions& measured) {
  const auto free = adjustOnce(std::move(map), camera, measured);
  if (!free) return std::nullopt;
  double freedom = 0;
  bool has_translation = false;
  for (const KnownMotion& known : motions) {
    freedom += known.has_translation ? 6 : 3;
    has_translation = has_translation || known.has_translation;
  }
  if (has_translation) --freedom;  // the unit in metres is free
  InitialMap knowing = *free;
  knowing.known_motions = motions;
  auto bound = adjustOnce(std::move(knowing), camera, measured);
  if (!bound) return std::nullopt;
  // With the motions' own cost this is twice the drop of the logarithm of the likelihood.
  const auto with = reprojectionCost(*bound, camera, measured);
  const auto without = reprojectionCost(*free, camera, measured);
  if (!with || !without) return std::nullopt;
  const double limit = freedom + kContradiction * std::sqrt(2 * freedom);
  if (2 * (*with - *without) > limit) return std::nullopt;
  return bound;
}

}  // namespace

std::vector<KnownMotion> knownMotions(const std::vector<FramePtr>& all,
                                      const std::vector<std::size_t>& frames) {
  std::vector<char> wanted(all.size(), 0);
  wanted.front() = 1;
  for (const std::size_t frame : frames) wanted[frame] = 1;
  std::vector<KnownMotion> known;
  for (const std::size_t to : frames) {
    if (to == 0) continue;
    if (const auto motion = chainTo(to, all, wanted)) known.push_back(*motion);
  }
  return known;
}

MotionAdjustment adjustWithMotions(InitialMap map,
                                   const std::vector<KnownMotion>& motions,
                                   const PinholeCamera& camera,
                                   const GeometricOptions& options) {
  if (motions.empty()) return {std::move(map), std::nullopt};
  GeometricOptions measured = options;
  measured.sigma = noiseOf(map, camera);
  const FramePtr& reference = map.frames.front().frame;  // null: motion without images, in tests
  if (reference && isRolling(*reference)) {  // else the skew of the images speaks against them
    if (auto rolling = withRowMotions(map, camera, measured)) {
      GeometricOptions known_rows = options;
      known_rows.sigma = noiseOf(*rolling, camera);
      auto bound = boundByMotions(std::move(*rolling), motions, camera, known_rows);
      if (bound) return {std::move(*bound), true};
    }
  }
  auto bound = boundByMotions(map, motions, camera, measured);
  if (bound) return {std::move(*bound), true};
  return {std::move(map), false};
}

}  // namespace dsorb::init_orb
