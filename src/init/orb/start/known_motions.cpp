// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/start/known_motions.h"

#include "dsorb/geometry/se3.h"
#include "dsorb/image/frame_priors.h"

#include "base/median.h"
#include "base/spread_frames.h"
#include "estimate/rolling_shutter.h"
#include "init/orb/bundle/map_assembly.h"
#include "init/orb/bundle/reprojection_equations.h"
#include "init/orb/bundle/robust_adjustment.h"
#include "init/orb/map/initial_map.h"

#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

namespace dsorb::init_orb {
namespace {

constexpr double kMinNoise = 0.05;  // of tracks, however well they fit [px]
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

/// Largest relative deviation, after it was widened, with which depths still give a start.
constexpr double kMaxRelativeSigma = 0.15;
constexpr double kMaxInnovationNoise = 1;  // [px]; more is no noise but a pose that does not fit
constexpr double kInnovationFreedom = 4;   // of the t-distribution of an innovation
constexpr double kInflationStep = 1.2;
constexpr int kInflations = 26;  // up to 95
/// Log likelihood by which another inflation may be worse than the best and still be believed: two
/// standard deviations.
constexpr double kLikelihoodGap = 2;
/// Median epipolar distance of a motion from known depths over that of the best motion.
constexpr double kMaxMisfit = 2;

/// Corners of all tracks whose depth is known, in metres; the newest frame where the camera has
/// only turned.
InitialMap makeMap(const ReferenceView& view, const RotationFit& rotation) {
  const DepthLookup lookup(*view.frames.front()->priors()->depth, 1, 1);
  const std::vector<Eigen::Vector2f>& pixels = view.tracks.positions.front();
  MotionHypothesis motion;
  motion.T_cur_ref = SE3(rotation.R_cur_ref, Eigen::Vector3d::Zero());
  motion.points.resize(pixels.size());
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    if (!view.tracks.positions.back()[i].allFinite()) continue;
    const Eigen::Vector2f seen = view.tracks.seen.empty() ? pixels[i] : view.tracks.seen[i];
    const KnownInverseDepth known = lookup.at(seen);
    if (known) motion.points[i] = TriangulatedPoint{known.mean, known.variance};
  }
  InitialMap map = makeInitialMap(view.frames, view.tracks, motion);
  map.readout = view.readout;
  map.metres = 1;
  return map;
}

/// Sets what is known of every corner.
void setKnown(double inflation, InitialMap& map) {
  const DepthLookup lookup(*map.frames.front().frame->priors()->depth, map.metres, inflation);
  for (Corner& corner : map.corners) corner.known = lookup.at(corner.seen());
}

/// What the newest frame says of the known inverse depths, its pose taken as right. The noise is
/// that across the epipolar lines, where depths have no part.
std::vector<DepthInnovation> innovationsOf(const InitialMap& map, const PinholeCamera& camera) {
  std::vector<DepthInnovation> innovations;
  std::vector<double> across;
  for (const CornerObservation& observation : map.observations) {
    if (observation.frame + 1 != map.frames.size()) continue;
    const KnownInverseDepth& known = map.corners[observation.corner].known;
    const auto projection = projectHosted(camera,
                                          *map.frames.back().T_cam_ref,
                                          camera.unproject(map.corners[observation.corner].pixel),
                                          known.mean);
    if (!projection) continue;
    const Eigen::Vector2d& speed = projection->J_inverse_depth;
    const Eigen::Vector2d error = observation.pixel - projection->pixel;
    const double square = std::max(speed.squaredNorm(), 1e-12);
    across.push_back(std::abs(speed.x() * error.y() - speed.y() * error.x()) / std::sqrt(square));
    innovations.push_back({speed.dot(error) / square, known.variance, 1 / square});
  }
  const double noise =
      std::clamp(kMadToSigma * medianInPlace(across), kMinNoise, kMaxInnovationNoise);
  for (DepthInnovation& innovation : innovations) innovation.image_variance *= noise * noise;
  return innovations;
}

double logLikelihood(const std::vector<DepthInnovation>& innovations, double inflation) {
  double sum = 0;
  for (const DepthInnovation& innovation : innovations) {
    const double variance =
        inflation * inflation * innovation.known_variance + innovation.image_variance;
    const double square = innovation.error * innovation.error / variance;
    sum -= 0.5 * std::log(variance) +
           0.5 * (kInnovationFreedom + 1) * std::log1p(square / kInnovationFreedom);
  }
  return sum;
}

/// Median of what is known, over its inverse depth.
double relativeSigma(const InitialMap& map) {
  std::vector<double> sigmas;
  for (const Corner& corner : map.corners) {
    if (corner.known) sigmas.push_back(std::sqrt(corner.known.variance) / corner.known.mean);
  }
  return medianInPlace(sigmas);
}

/// Lets the corners know their depths, with deviations widened as the present pose wants it.
/// @return whether the depths give a start
bool weighDepths(const PinholeCamera& camera, InitialMap& map, DepthPriorReport& report) {
  setKnown(1, map);
  const auto innovations = innovationsOf(map, camera);
  if (innovations.empty()) return false;
  report.inflation = claimInflation(innovations);
  const double claimed = relativeSigma(map);
  setKnown(report.inflation, map);
  const bool of_use = relativeSigma(map) <= kMaxRelativeSigma;
  report.contradicted = claimed <= kMaxRelativeSigma && !of_use;
  return of_use;
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

std::optional<bool> adjustWithMotions(InitialMap& map,
                                      const std::vector<KnownMotion>& motions,
                                      const PinholeCamera& camera,
                                      const GeometricOptions& options) {
  if (motions.empty()) return std::nullopt;
  const auto bind = [&](InitialMap start) {
    GeometricOptions measured = options;
    measured.sigma = noiseOf(start, camera);
    auto bound = boundByMotions(std::move(start), motions, camera, measured);
    if (bound) map = std::move(*bound);
    return bound.has_value();
  };
  const FramePtr& reference = map.frames.front().frame;  // null: motion without images, in tests
  if (reference && isRolling(*reference)) {  // else the skew of the images speaks against them
    GeometricOptions measured = options;
    measured.sigma = noiseOf(map, camera);
    auto rolling = withRowMotions(map, camera, measured);
    if (rolling && bind(std::move(*rolling))) return true;
  }
  return bind(map);
}

bool knowsDepth(const ReferenceView& view) {
  const FramePriors* priors = view.frames.front()->priors();
  return priors != nullptr && priors->depth;
}

double claimInflation(const std::vector<DepthInnovation>& innovations) {
  std::vector<double> likelihoods;
  double inflation = 1;
  for (int i = 0; i < kInflations; ++i, inflation *= kInflationStep) {
    likelihoods.push_back(logLikelihood(innovations, inflation));
  }
  const double enough = *std::max_element(likelihoods.begin(), likelihoods.end()) - kLikelihoodGap;
  const auto least = std::find_if(
      likelihoods.begin(), likelihoods.end(), [enough](double value) { return value >= enough; });
  return std::pow(kInflationStep, static_cast<double>(least - likelihoods.begin()));
}

bool fitsLikeTheBest(const SE3& T_cur_ref, const Matches& matches, const AttemptContext& context) {
  const auto best = estimateEssentialMotion(matches, context.camera, context.seed());
  if (!best) return true;
  const auto misfit = [&](const SE3& motion) {
    return medianOf(epipolarDistances(motion, matches, context.camera));
  };
  return misfit(T_cur_ref) <= kMaxMisfit * std::max(kMinNoise, misfit(best->T_cur_ref));
}

KnownDepthStart startOfKnownDepths(const ReferenceView& view,
                                   const RotationFit& rotation,
                                   const AttemptContext& context) {
  const PinholeCamera& camera = context.camera;
  const GeometricOptions& options = context.options.orb.geometric;
  KnownDepthStart start;
  InitialMap map = makeMap(view, rotation);
  start.report.corners = static_cast<int>(map.corners.size());
  if (start.report.corners < kMinCornersOfMotion) return start;
  PosedFrame& newest = map.frames.back();
  const auto observations = observationsByFrame(map, camera);
  const auto pose = poseFromPoints(observations.back(), camera, *newest.T_cam_ref, kTrackSigma);
  if (!pose) return start;
  newest.T_cam_ref = *pose;
  if (!weighDepths(camera, map, start.report)) return start;
  const auto frames = spreadFrames(view.frames.size(), kAdjustedFrames);
  poseFrames(map, camera, frames);
  auto robust = adjustRobustly(std::move(map), camera, options);
  if (!robust || !weighDepths(camera, *robust, start.report)) return start;
  MotionCandidate& candidate = start.candidate.emplace();
  candidate.map = std::move(*robust);
  candidate.live_tracks = start.report.corners;
  candidate.motions_used =
      adjustWithMotions(candidate.map, knownMotions(view.frames, frames), camera, options);
  candidate.front_share = 1;
  start.report.used = true;
  return start;
}

}  // namespace dsorb::init_orb
