// SPDX-License-Identifier: BSD-3-Clause
#include "init/coarse/coarse_handover.h"

#include "base/angles.h"
#include "base/median.h"
#include "base/random.h"
#include "estimate/marginals.h"
#include "image/cell_grid.h"
#include "image/photometric.h"
#include "init/result.h"
#include "init/wrong_direction.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <utility>

namespace dsorb::init_coarse {
namespace {

constexpr int kHandoverPoints = 2000;  // of the result, at most

// Effective numbers of points in the variance of the pose and in the part of an inverse depth's
// that comes from it, which is larger, since the depths absorb some errors of the pose.
constexpr double kPoseEffectivePoints = 2.5;
constexpr double kDepthEffectivePoints = 50;
constexpr float kMinCurvature = 1;  // [grey levels^2 unit^2]; less tells nothing

// Per level, finest first, when a frame is aligned to known depths from a good start.
constexpr std::array<int, 5> kPoseIterations = {2, 3, 5, 10, 10};
constexpr double kMinPoseInlierShare = 0.5;   // of the points in view, else a frame has no pose
constexpr double kMinPoseVisibleShare = 0.2;  // of all points, else a frame has no pose
constexpr double kMaxMargin = 1e3;            // reported where there is no rival
constexpr double kUnknownVariance = 1;        // of an inverse depth the newest frame does not tell

/// Scale of the t-distribution of a direction's errors over the sigmas of its covariance, and what
/// the energies of a whole image are worth, in independent samples, between motions. Both were
/// chosen on starts of which 0 of 36 are wrong where .03 is predicted, and 5 of 9 where .5 is.
constexpr double kDirectionScale = 0.5;
constexpr double kRivalSamples = 5;
constexpr double kTellingMargin = 1.5;  // a larger one tells no more: the right motion may be none
                                        // of those that were tried

/// Levels with the smoothed inverse depths as the ones evaluated.
std::vector<PointLevel> fixedLevels(const std::vector<PointLevel>& levels) {
  std::vector<PointLevel> fixed = levels;
  for (PointLevel& level : fixed) level.trial_inverse_depth = level.inverse_depth = level.smoothed;
  return fixed;
}

/// Coarse-to-fine alignment of one frame at known inverse depths; the finest level is the last.
LevelReport alignFrame(const CoarseAttempt& attempt,
                       const Frame& frame,
                       Unknowns unknowns,
                       LevelAligner& aligner,
                       std::pair<std::vector<PointLevel>&, Alignment&> state) {
  auto& [fixed, alignment] = state;
  LevelReport report;
  for (int l = static_cast<int>(fixed.size()) - 1; l >= 0; --l) {
    PointLevel& points = fixed[static_cast<std::size_t>(l)];
    points.good = attempt.levels[static_cast<std::size_t>(l)].good;
    report = aligner.align(viewOf(frame, attempt.camera, l),
                           kPoseIterations[static_cast<std::size_t>(l)],
                           unknowns,
                           points,
                           alignment);
  }
  return report;
}

double energyPerPoint(const LevelState& state) {
  return state.sums.good > 0 ? state.sums.good_energy / state.sums.good : HUGE_VAL;
}

/// Start of an earlier frame's alignment: its own estimate, that of the frame after it, or what
/// lies between the latter and the reference; the best on the coarsest level.
Alignment bestStart(const CoarseAttempt& attempt,
                    const AlignedFrame& tracked,
                    const std::pair<Alignment, double>& next,
                    LevelAligner& aligner,
                    PointLevel& coarsest) {
  const int level = static_cast<int>(attempt.levels.size()) - 1;
  std::vector<Alignment> starts = {tracked.alignment, tracked.alignment, next.first};
  starts[1].T_cur_ref = SE3::exp(next.second * next.first.T_cur_ref.log());
  double best = HUGE_VAL;
  Alignment result = tracked.alignment;
  for (const Alignment& start : starts) {
    coarsest.good = attempt.levels.back().good;
    const double energy = energyPerPoint(aligner.evaluate(
        viewOf(*tracked.frame, attempt.camera, level), Unknowns::kPose, coarsest, start));
    if (energy < best) {
      best = energy;
      result = start;
    }
  }
  return result;
}

/// Mean squared residual of the good points of level 0 [grey levels^2].
double residualVariance(const LevelState& state) {
  return energyPerPoint(state) / kPatternSize;
}

/// Whether a point was seen well enough in the newest frame to be handed over.
bool isFit(const CoarseAttempt& attempt, std::size_t i) {
  const PointLevel& points = attempt.levels.front();
  return attempt.options.published ||
         (points.good[i] != 0 && points.energy[i] <= kPatternOutlierEnergy);
}

/// Indices of the points to hand over, ascending.
std::vector<std::size_t> randomPoints(const CoarseAttempt& attempt) {
  const PointLevel& points = attempt.levels.front();
  const double share = static_cast<double>(kHandoverPoints) / points.size();
  Random random(static_cast<std::uint64_t>(attempt.seed));
  std::vector<std::size_t> kept;
  for (std::size_t i = 0; i < points.x.size(); ++i) {
    if (isFit(attempt, i) && random.uniform() < share) kept.push_back(i);
  }
  return kept;
}

/// The point of the largest curvature of each cell of a grid with as many cells as points wanted.
std::vector<std::size_t> spreadPoints(const CoarseAttempt& attempt) {
  const PointLevel& points = attempt.levels.front();
  const PinholeCamera& camera = attempt.camera;
  const double area = static_cast<double>(camera.width) * camera.height;
  const CellGrid cells(camera.width, camera.height, std::sqrt(area / kHandoverPoints));
  std::vector<std::size_t> fit;
  for (std::size_t i = 0; i < points.x.size(); ++i) {
    if (isFit(attempt, i)) fit.push_back(i);
  }
  return bestOfCells(
      cells,
      fit,
      [&](std::size_t i) { return Eigen::Vector2f(points.x[i], points.y[i]); },
      [&](std::size_t a, std::size_t b) { return points.curvature[a] > points.curvature[b]; });
}

/// Formal variance of an inverse depth at a known pose.
double formalVariance(const PointLevel& points, std::size_t i, double residual_variance) {
  return residual_variance / std::max(static_cast<double>(points.curvature[i]), 1.0);
}

std::vector<InitPoint> makePoints(const CoarseAttempt& attempt, LevelAligner& aligner) {
  const PointLevel& points = attempt.levels.front();
  PointLevel fixed = points;
  fixed.trial_inverse_depth = fixed.inverse_depth = fixed.smoothed;
  const auto uncertainty = uncertaintyOf(attempt, attempt.frames.back(), fixed, {}, aligner);
  std::vector<InitPoint> result;
  for (const std::size_t i :
       attempt.options.published ? randomPoints(attempt) : spreadPoints(attempt)) {
    InitPoint point;
    point.pixel = {points.x[i] - kPixelOffset, points.y[i] - kPixelOffset};
    point.inverse_depth = std::max(points.smoothed[i], kMinInverseDepth);
    const double variance = uncertainty ? uncertainty->inverse_depth[i] : 0.0;
    const float smoothing = neighbourSpread(points, i);  // has the own uncertainty in it, too
    point.variance = std::max(static_cast<float>(variance > 0 ? variance : kUnknownVariance),
                              smoothing * smoothing);
    point.observations = 2;
    result.push_back(point);
  }
  return result;
}

/// Probability that the newest frame's direction is wrong, by its own errors or because a motion
/// elsewhere is the right one; nothing where one of them was not looked at.
std::optional<double> wrongProbability(const PosedFrame& newest,
                                       const Quality& quality,
                                       const CoarseAttempt& attempt) {
  const CoarseOptions& o = attempt.options;
  if (o.published || !(o.min_rival_margin > 0) || !newest.covariance) return std::nullopt;
  const double errors =
      tailProbability(kDirectionScale * directionSigmasDeg(newest), attempt.wrong_angle_deg);
  const double rival =
      rivalProbability(1.0 + std::min(quality.rival_margin, kTellingMargin), kRivalSamples);
  return 1 - (1 - errors) * (1 - rival);
}

/// Poses of all frames at the final inverse depths, the newest first, so that each starts from a
/// neighbour's; the order of the result is that of the frames.
std::vector<PosedFrame> poseFrames(const CoarseAttempt& attempt, LevelAligner& aligner) {
  const std::vector<AlignedFrame>& frames = attempt.frames;
  const Frame& reference = *frames.front().frame;
  std::vector<PosedFrame> posed(frames.size());
  posed.front() = {frames.front().frame, SE3(), {}, std::nullopt};
  std::vector<PointLevel> fixed = fixedLevels(attempt.levels);
  const std::vector<float>& known = attempt.levels.front().curvature;
  Alignment next = frames.back().alignment;
  for (std::size_t k = frames.size() - 1; k > 0; --k) {
    const double fraction = static_cast<double>(k) / static_cast<double>(k + 1);
    Alignment alignment = frames[k].alignment;
    if (k + 1 < frames.size()) {
      alignment = bestStart(attempt, frames[k], {next, fraction}, aligner, fixed.back());
    }
    const LevelReport report =
        alignFrame(attempt, *frames[k].frame, Unknowns::kPose, aligner, {fixed, alignment});
    posed[k].frame = frames[k].frame;
    const bool newest = k + 1 == frames.size();
    if (!newest && (report.inlierShare() < kMinPoseInlierShare ||
                    report.visibleShare() < kMinPoseVisibleShare)) {
      continue;
    }
    posed[k].T_cam_ref = alignment.T_cur_ref;
    posed[k].affine = relativeBrightness(reference, *frames[k].frame, alignment);
    const auto uncertainty = uncertaintyOf(attempt,
                                           {frames[k].frame, alignment, {}},
                                           fixed.front(),
                                           newest ? std::vector<float>{} : known,
                                           aligner);
    if (uncertainty) posed[k].covariance = uncertainty->pose;
    next = alignment;
  }
  return posed;
}

}  // namespace

std::optional<Uncertainty> uncertaintyOf(const CoarseAttempt& attempt,
                                         const AlignedFrame& tracked,
                                         PointLevel& points,
                                         const std::vector<float>& curvature,
                                         LevelAligner& aligner) {
  const LevelState state = aligner.evaluate(
      viewOf(*tracked.frame, attempt.camera, 0), Unknowns::kPose, points, tracked.alignment);
  LinearSystem<float> system = aligner.evaluated();
  std::vector<double> depths(points.x.size(), 0.0);
  std::vector<std::size_t> known;
  for (std::size_t i = 0; i < points.x.size(); ++i) {
    const float elsewhere = curvature.empty() ? 0.0F : curvature[i];
    const float total = points.trial_good[i] != 0 ? points.trial_curvature[i] + elsewhere : 0.0F;
    system.depth_hessian[i] = total < kMinCurvature ? 0.0F : total;
    if (!system.known(i)) continue;
    depths[i] = static_cast<double>(points.trial_inverse_depth[i]);
    known.push_back(i);
  }
  Vector8d scale = Vector8d::Zero();
  scale.head<3>() = tracked.alignment.T_cur_ref.translation();
  const Marginals marginals(system, scale, depths);
  if (known.empty() || !marginals.usable()) return std::nullopt;
  const auto count = static_cast<double>(known.size());
  const double variance = state.sums.good_energy / (kPatternSize * count);
  const auto inflation = [&](double points_that_tell) {
    return std::max(1.0, count / points_that_tell);
  };
  const Eigen::MatrixXd roots = marginals.inGauge(marginals.roots()).topRows<6>();
  const Vector6d of_scale = scale.head<6>();
  Uncertainty result;
  result.pose =
      variance * inflation(kPoseEffectivePoints) *
      (roots * roots.transpose() + marginals.depthVariance() * of_scale * of_scale.transpose());
  Eigen::MatrixXd effects(scale.size(), static_cast<Eigen::Index>(known.size()));
  for (Eigen::Index k = 0; k < effects.cols(); ++k) {
    const std::size_t i = known[static_cast<std::size_t>(k)];
    marginals.depthEffect(system, i, depths[i], effects.col(k));
  }
  const Eigen::VectorXd from_pose =
      marginals.solve(effects).cwiseProduct(effects).colwise().sum().transpose();
  result.inverse_depth.assign(points.x.size(), 0.0);
  for (Eigen::Index k = 0; k < effects.cols(); ++k) {
    const std::size_t i = known[static_cast<std::size_t>(k)];
    result.inverse_depth[i] = variance * (marginals.ownVariance(system, i, depths[i]) +
                                          inflation(kDepthEffectivePoints) * from_pose[k]);
  }
  return result;
}

LevelView viewOf(const Frame& frame, const PinholeCamera& camera, int level) {
  return {&frame.level(level), camera.atLevel(level)};
}

double logExposureRatio(const Frame& reference, const Frame& frame) {
  if (!(reference.exposure() > 0 && frame.exposure() > 0)) return 0;
  return std::log(frame.exposure() / reference.exposure());
}

AffineBrightness relativeBrightness(const Frame& reference,
                                    const Frame& frame,
                                    const Alignment& alignment) {
  return {alignment.log_gain - logExposureRatio(reference, frame), alignment.offset};
}

double parallaxDeg(const CoarseAttempt& attempt) {
  const PointLevel& points = attempt.levels.front();
  const SE3& T = attempt.frames.back().alignment.T_cur_ref;
  std::vector<double> angles;
  for (std::size_t i = 0; i < points.x.size(); ++i) {
    if (points.good[i] == 0) continue;
    const Eigen::Vector3d ray =
        T.unitQuaternion() * attempt.camera.unproject({points.x[i], points.y[i]});
    const Eigen::Vector3d moved = ray + static_cast<double>(points.smoothed[i]) * T.translation();
    angles.push_back(angleDeg(ray, moved));
  }
  return medianOf(std::move(angles));
}

RotationTest testRotation(const CoarseAttempt& attempt, LevelAligner& aligner) {
  std::vector<PointLevel> fixed = fixedLevels(attempt.levels);
  const AlignedFrame& newest = attempt.frames.back();
  const LevelState full = aligner.evaluate(
      viewOf(*newest.frame, attempt.camera, 0), Unknowns::kPose, fixed.front(), newest.alignment);
  RotationTest test;
  test.rotation = newest.rotation;
  const LevelReport still =
      alignFrame(attempt, *newest.frame, Unknowns::kRotation, aligner, {fixed, test.rotation});
  test.motion_gain = 1.0 - energyPerPoint(full) / energyPerPoint(still.state);
  return test;
}

Quality judge(const CoarseAttempt& attempt, LevelAligner& aligner) {
  Quality quality;
  std::vector<PointLevel> fixed = fixedLevels(attempt.levels);
  const AlignedFrame& newest = attempt.frames.back();
  const LevelState full = aligner.evaluate(
      viewOf(*newest.frame, attempt.camera, 0), Unknowns::kPose, fixed.front(), newest.alignment);
  quality.inlier_share =
      full.sums.good > 0 ? static_cast<double>(full.sums.inliers) / full.sums.good : 0.0;
  quality.visible_share = static_cast<double>(full.sums.good) / std::max(fixed.front().size(), 1);
  quality.residual_rms = std::sqrt(residualVariance(full));
  quality.parallax_deg = parallaxDeg(attempt);
  if (quality.parallax_deg < attempt.options.min_parallax_deg) {
    quality.reason = InitReason::kTooLittleParallax;
    return quality;
  }
  std::vector<double> sigmas;
  for (std::size_t i = 0; i < fixed.front().x.size(); ++i) {
    if (fixed.front().good[i] == 0) continue;
    const double variance = formalVariance(attempt.levels.front(), i, residualVariance(full));
    sigmas.push_back(std::sqrt(variance) / static_cast<double>(fixed.front().smoothed[i]));
  }
  quality.relative_sigma = medianOf(std::move(sigmas));
  quality.motion_gain = testRotation(attempt, aligner).motion_gain;

  const CoarseOptions& o = attempt.options;
  if (quality.motion_gain < o.min_motion_gain) {
    quality.reason = InitReason::kDegenerateMotion;
  } else if (1.0 - quality.inlier_share > o.max_outlier_share ||
             (o.max_relative_sigma > 0 && quality.relative_sigma > o.max_relative_sigma)) {
    quality.reason = InitReason::kPoorQuality;
  }
  return quality;
}

InitializationResult handOver(const CoarseAttempt& attempt,
                              const Quality& quality,
                              LevelAligner& aligner) {
  InitializationResult result;
  result.frames = poseFrames(attempt, aligner);
  result.points = makePoints(attempt, aligner);
  normalizeScale(result);
  InitReport& report = result.report;
  report.model = "direct";
  report.median_relative_sigma = quality.relative_sigma;
  report.wrong_probability = wrongProbability(result.frames.back(), quality, attempt);
  report.add("parallax_deg", quality.parallax_deg);
  report.add("inlier_ratio", quality.inlier_share);
  report.add("residual_rms_grey", quality.residual_rms);
  report.add("visible_share", quality.visible_share);
  report.add("motion_gain", quality.motion_gain);
  report.add("rival_margin", std::min(quality.rival_margin, kMaxMargin));
  return result;
}

}  // namespace dsorb::init_coarse
