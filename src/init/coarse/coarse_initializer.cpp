// SPDX-License-Identifier: BSD-3-Clause
#include "init/coarse/coarse_initializer.h"

#include "base/angles.h"
#include "base/median.h"
#include "base/parallel.h"
#include "base/random.h"
#include "estimate/marginals.h"
#include "image/cell_grid.h"
#include "image/photometric.h"
#include "image/pixel_selector.h"
#include "init/result.h"
#include "init/waiting_frames.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdlib>
#include <stdexcept>
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

/// The alignment of least energy, the first of equals; the first one where none has an energy.
template <typename Energy>
Alignment leastOf(const std::vector<Alignment>& candidates, const Energy& energy) {
  double least = HUGE_VAL;
  const Alignment* best = &candidates.front();
  for (const Alignment& candidate : candidates) {
    const double value = energy(candidate);
    if (!(value < least)) continue;
    least = value;
    best = &candidate;
  }
  return *best;
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
  return leastOf(starts, [&](const Alignment& start) {
    coarsest.good = attempt.levels.back().good;
    return energyPerPoint(aligner.evaluate(
        viewOf(*tracked.frame, attempt.camera, level), Unknowns::kPose, coarsest, start));
  });
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

constexpr std::array<int, 5> kIterations = {5, 5, 10, 30, 50};  // per level, finest first
constexpr std::size_t kRivals = 3;   // of an estimate, aligned on all levels
constexpr double kConverged = 0.98;  // of the energy left by a pass: the next one would not help
// Passes after the first one took away up to 0.27 of its energy, those after the second one no more
// each than it did (20 contests on five sequences; one estimate of 80 did better, and lost).
constexpr double kMaxLaterGain = 0.35;
constexpr double kSameDirection = 0.94;  // cosine of 20 deg

double robustEnergy(const LevelReport& report) {
  return report.state.sums.robustEnergy(report.points);
}

/// Motion along t with the rotation that keeps the plane of unit depth in place.
Alignment hypothesis(const Alignment& rotation, const Eigen::Vector3d& t) {
  Vector6d turn = Vector6d::Zero();
  turn[3] = t.y();
  turn[4] = -t.x();
  Alignment result = rotation;
  result.T_cur_ref = SE3::exp(turn) * rotation.T_cur_ref;
  result.T_cur_ref.setTranslation(t);
  result.snapped = true;
  return result;
}

/// Mean inverse depth of the good points.
float meanInverseDepth(const PointLevel& points) {
  double sum = 0;
  int count = 0;
  for (std::size_t i = 0; i < points.x.size(); ++i) {
    if (points.good[i] == 0) continue;
    sum += static_cast<double>(points.smoothed[i]);
    ++count;
  }
  return count > 0 ? static_cast<float>(sum / count) : 1.0F;
}

/// The axes and the diagonals between them, both ways.
std::vector<Eigen::Vector3d> directions() {
  std::vector<Eigen::Vector3d> result;
  for (int x = -1; x <= 1; ++x) {
    for (int y = -1; y <= 1; ++y) {
      for (int z = -1; z <= 1; ++z) {
        const int parts = std::abs(x) + std::abs(y) + std::abs(z);
        if (parts == 1 || parts == 3) result.push_back(Eigen::Vector3d(x, y, z).normalized());
      }
    }
  }
  return result;
}

bool sameDirection(const Alignment& a, const Alignment& b) {
  const Eigen::Vector3d t_a = a.T_cur_ref.translation().normalized();
  return t_a.dot(b.T_cur_ref.translation().normalized()) > kSameDirection;
}

/// All points good and on the plane of unit depth.
void restart(PointLevel& level) {
  flatten(level);
  std::fill(level.good.begin(), level.good.end(), std::uint8_t{1});
}

void sortByEnergy(std::vector<Estimate>& estimates) {
  std::stable_sort(estimates.begin(), estimates.end(), [](const Estimate& a, const Estimate& b) {
    return a.energy() < b.energy();
  });
}

/// Calls function(task, estimate) for all estimates from one on, at the same time where threads are
/// free; each task has an aligner, which holds buffers, of its own.
template <typename Function>
void forEachOf(std::vector<Estimate>& estimates,
               std::size_t first,
               const AlignmentTask& task,
               const Function& function) {
  forEachRange(estimates.size() - first, 1, [&](std::size_t begin, std::size_t end) {
    LevelAligner aligner(task.options);
    const AlignmentTask own{task.frame, task.camera, task.options, aligner};
    for (std::size_t i = first + begin; i < first + end; ++i) function(own, estimates[i]);
  });
}

/// Levels from `finest` on; the finer ones stay empty.
std::vector<PointLevel> coarseLevels(const std::vector<PointLevel>& levels, std::size_t finest) {
  std::vector<PointLevel> coarse(levels.size());
  std::copy(levels.begin() + static_cast<std::ptrdiff_t>(finest),
            levels.end(),
            coarse.begin() + static_cast<std::ptrdiff_t>(finest));
  return coarse;
}

/// Gives back what coarseLevels() left out, on the plane of unit depth.
void addFineLevels(const std::vector<PointLevel>& all, std::vector<PointLevel>& levels) {
  for (std::size_t l = 0; l < levels.size() && levels[l].x.empty(); ++l) {
    levels[l] = all[l];
    restart(levels[l]);
  }
}

/// Estimates from the plane of unit depth, of the coarse levels alone, the best first.
std::vector<Estimate> screenDirections(const AlignmentTask& task,
                                       const Alignment& rotation,
                                       const Estimate& given) {
  const int finest = std::max(static_cast<int>(given.levels.size()) - 2, 0);
  const double length = given.alignment.T_cur_ref.translation().norm() *
                        static_cast<double>(meanInverseDepth(given.levels.front()));
  std::vector<Estimate> screened;
  for (const Eigen::Vector3d& direction : directions()) {
    screened.push_back({coarseLevels(given.levels, static_cast<std::size_t>(finest)),
                        hypothesis(rotation, length * direction),
                        {}});
    for (PointLevel& level : screened.back().levels) restart(level);
  }
  forEachOf(screened, 0, task, [finest](const AlignmentTask& own, Estimate& trial) {
    alignLevels(own, finest, trial);
  });
  sortByEnergy(screened);
  return screened;
}

constexpr int kRotationIterations = 10;
constexpr double kMinMatchShare = 0.8;  // of the points in view, else the grid is searched
constexpr double kGridStep = 1.5;       // [px of the coarsest level], within the alignment's reach
constexpr int kGridRadius = 3;          // steps: 72 px of level 0 with five levels

std::vector<Alignment> gridAround(const Alignment& center, const PinholeCamera& camera) {
  std::vector<Alignment> grid;
  for (int i = -kGridRadius; i <= kGridRadius; ++i) {
    for (int j = -kGridRadius; j <= kGridRadius; ++j) {
      Vector6d turn = Vector6d::Zero();
      turn[3] = kGridStep * i / camera.fy;
      turn[4] = kGridStep * j / camera.fx;
      grid.push_back(center);
      grid.back().T_cur_ref = SE3::exp(turn) * center.T_cur_ref;
    }
  }
  return grid;
}

constexpr float kSelectionFactor = 2;      // on the selector's thresholds, level 0
constexpr int kFirstGridSpacing = 5;       // of the grid maxima, levels from 1 [px]
constexpr int kMinPoints = 100;            // of level 0, else the frame is no reference
constexpr double kMinSpread = 0.02;        // of them across their main direction [diagonals]
constexpr double kMinVisibleShare = 0.25;  // points in view, else the reference is too far away
constexpr double kMaxInlierDrop = 0.5;     // of the share of the frame before: the scene was cut
constexpr int kMaxSettleFrames = 5;        // to wait for the wanted parallax; as published
constexpr int kMaxRefusals = 3;            // for poor quality; then the estimate is given up
constexpr double kMatchShare = 0.8;        // of all points; once over the levels was enough
constexpr std::size_t kKeptFrames = 40;    // in memory at most

/// Points of all levels, finest first, with neighbours and parents.
std::vector<PointLevel> selectPoints(const Frame& frame, const CoarseOptions& options, int seed) {
  const auto wanted = [&](int level) {
    const int dense = wantedPoints(level, frame.width(), frame.height());
    return options.max_points > 0 ? std::min(dense, options.max_points) : dense;
  };
  PixelSelectorOptions selector_options;
  selector_options.seed = seed;
  PixelSelector selector(frame.width(), frame.height(), selector_options);
  std::vector<PointLevel> levels;
  levels.push_back(
      makePointLevel(frame.level(0), selector.select(frame, wanted(0), kSelectionFactor)));
  int spacing = kFirstGridSpacing;
  for (int l = 1; l < frame.pyramid().levels(); ++l) {
    const GridSelection selection = selectGridMaxima(frame.level(l), wanted(l), spacing);
    spacing = selection.spacing;
    levels.push_back(makePointLevel(frame.level(l), selection.pixels));
    findParents(levels.back(), options.max_parent_distance, levels[levels.size() - 2]);
  }
  return levels;
}

/// Standard deviation of the points across the line they lie along best [px]: points on one line
/// lie in a plane with the camera's centre and determine no motion.
double spreadAcross(const PointLevel& level) {
  const Eigen::Map<const Eigen::ArrayXf> x(level.x.data(), level.size());
  const Eigen::Map<const Eigen::ArrayXf> y(level.y.data(), level.size());
  const Eigen::ArrayXd dx = x.cast<double>() - x.cast<double>().mean();
  const Eigen::ArrayXd dy = y.cast<double>() - y.cast<double>().mean();
  const double xx = dx.square().mean();
  const double yy = dy.square().mean();
  const double smaller_eigenvalue = 0.5 * (xx + yy) - std::hypot(0.5 * (xx - yy), (dx * dy).mean());
  return std::sqrt(std::max(smaller_eigenvalue, 0.0));
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
  quality.inlier_share = full.sums.inlierShare();
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
  return result;
}

double Estimate::energy() const {
  return robustEnergy(finest);
}

void alignLevels(const AlignmentTask& task, int finest, Estimate& estimate) {
  std::vector<PointLevel>& levels = estimate.levels;
  Alignment& alignment = estimate.alignment;
  const int top = static_cast<int>(levels.size()) - 1;
  for (int l = top; l >= finest; --l) {
    PointLevel& points = levels[static_cast<std::size_t>(l)];
    if (l < top) {
      propagateDown(levels[static_cast<std::size_t>(l) + 1], points);
      regularize(alignment.snapped, points);
    } else {
      reviveFromNeighbours(points);
    }
    points.trial_inverse_depth = points.inverse_depth;
    estimate.finest = task.aligner.align(viewOf(task.frame, task.camera, l),
                                         kIterations[static_cast<std::size_t>(l)],
                                         Unknowns::kAll,
                                         points,
                                         alignment);
  }
  for (int l = finest; l < top; ++l) {
    PointLevel& coarse = levels[static_cast<std::size_t>(l) + 1];
    propagateUp(levels[static_cast<std::size_t>(l)], !task.options.published, coarse);
    regularize(alignment.snapped, coarse);
  }
}

void converge(const AlignmentTask& task, const Aim& aim, Estimate& estimate) {
  double before = HUGE_VAL;
  for (int left = task.options.max_passes - 1; left >= 0; --left) {
    alignLevels(task, 0, estimate);
    const double energy = estimate.energy();
    if (estimate.finest.inlierShare() * estimate.finest.visibleShare() > aim.enough) break;
    if (energy > kConverged * before) break;
    const double possible_gain = std::min(left * (before - energy), kMaxLaterGain * energy);
    if (energy - possible_gain > aim.energy) break;
    before = energy;
  }
}

Contest contest(const AlignmentTask& task, const Alignment& rotation, const Estimate& given) {
  std::vector<Estimate> finalists = {given};
  for (Estimate& trial : screenDirections(task, rotation, given)) {
    const bool known = std::any_of(finalists.begin(), finalists.end(), [&](const Estimate& other) {
      return sameDirection(other.alignment, trial.alignment);
    });
    if (known) continue;
    addFineLevels(given.levels, trial.levels);
    finalists.push_back(std::move(trial));
    if (finalists.size() > kRivals) break;
  }
  converge(task, {}, finalists.front());
  Aim aim;
  aim.energy = (1.0 + task.options.min_rival_margin) * finalists.front().energy();
  forEachOf(finalists, 1, task, [&aim](const AlignmentTask& own, Estimate& finalist) {
    converge(own, aim, finalist);
  });
  sortByEnergy(finalists);
  const auto rival = std::find_if(finalists.begin(), finalists.end(), [&](const Estimate& other) {
    return !sameDirection(finalists.front().alignment, other.alignment);
  });
  const double margin =
      rival == finalists.end() ? HUGE_VAL : rival->energy() / finalists.front().energy() - 1.0;
  return {std::move(finalists.front()), margin};
}

double RotationSearch::energy(const LevelView& view, const Alignment& alignment) {
  std::fill(points_.good.begin(), points_.good.end(), std::uint8_t{1});
  return aligner_.evaluate(view, Unknowns::kRotation, points_, alignment)
      .sums.robustEnergy(points_.size());
}

Alignment RotationSearch::best(const LevelView& view, const std::vector<Alignment>& candidates) {
  return leastOf(candidates, [&](const Alignment& candidate) { return energy(view, candidate); });
}

double RotationSearch::refine(const LevelView& view, Alignment& alignment) {
  std::fill(points_.good.begin(), points_.good.end(), std::uint8_t{1});
  return aligner_.align(view, kRotationIterations, Unknowns::kRotation, points_, alignment)
      .inlierShare();
}

RotationMatch RotationSearch::find(const LevelView& coarsest,
                                   const std::vector<Alignment>& starts) {
  std::vector<Alignment> candidates = starts;
  for (Alignment& candidate : candidates) {
    candidate.T_cur_ref.setTranslation(Eigen::Vector3d::Zero());
    candidate.snapped = false;
  }
  const Alignment start = best(coarsest, candidates);
  Alignment near = start;
  if (refine(coarsest, near) >= kMinMatchShare) return {near, true};
  Alignment far = best(coarsest, gridAround(start, coarsest.camera));
  const bool matches = refine(coarsest, far) >= kMinMatchShare;
  return matches ? RotationMatch{far, true} : RotationMatch{best(coarsest, {near, far}), false};
}

CoarseInitializer::CoarseInitializer(const InitializerOptions& options, const PinholeCamera& camera)
    : options_(options),
      camera_(camera),
      arena_(options.num_threads),
      frame_check_(camera),
      aligner_(options.coarse),
      rotation_search_(options.coarse) {
  reset();
}

void CoarseInitializer::reset() {
  clock_.clear();
  attempt_ = CoarseAttempt{};
  attempt_.camera = camera_;
  attempt_.options = options_.coarse;
  attempt_.wrong_angle_deg = options_.orb.gate.wrong_angle_deg;
  attempt_.seed = options_.seed;
  snapped_since_ = tracked_ = refusals_ = 0;
  inlier_share_ = 0;
  done_ = false;
  resets_.clear();
  frame_check_.restart();
  last_motion_ = SE3();
}

InitStep CoarseInitializer::addFrame(FramePtr frame) {
  if (done_) throw std::logic_error("addFrame after a result: call reset() first");
  frame_check_.accept(frame);
  return arena_.run([&]() -> InitStep {
    if (attempt_.frames.empty()) {
      const bool enough = setReference(frame);
      return needsMoreFrames(enough ? InitReason::kFirstFrame : InitReason::kTooFewPoints);
    }
    return assess(clock_.time("alignment", [&] { return track(frame); }));
  });
}

bool CoarseInitializer::setReference(const FramePtr& frame) {
  snapped_since_ = tracked_ = refusals_ = 0;
  inlier_share_ = 0;
  attempt_.frames.clear();
  attempt_.levels =
      clock_.time("points", [&] { return selectPoints(*frame, options_.coarse, options_.seed); });
  const PointLevel& finest = attempt_.levels.front();
  const double diagonal = std::hypot(frame->width(), frame->height());
  if (finest.size() < kMinPoints || spreadAcross(finest) < kMinSpread * diagonal) return false;
  Alignment still;
  still.balanced = !options_.coarse.published;
  attempt_.frames.push_back({frame, still, still});
  rotation_search_.setReference(attempt_.levels.back());
  return true;
}

std::vector<Alignment> CoarseInitializer::startValues(const Frame& frame,
                                                      const Alignment& last,
                                                      const SE3& motion) const {
  Alignment start = last;
  const Frame& reference = *attempt_.frames.front().frame;
  const double log_ratio = logExposureRatio(reference, frame);
  start.exposure_log_gain = log_ratio;
  std::vector<Alignment> starts;
  if (options_.coarse.published) {
    start.log_gain = log_ratio;
    start.offset = 0;
    starts = {start};
  } else {
    start.log_gain += log_ratio - logExposureRatio(reference, *attempt_.frames.back().frame);
    starts = {start, start};
    starts.back().T_cur_ref = motion * start.T_cur_ref;
  }
  if (!start.snapped) {
    for (Alignment& value : starts) value.T_cur_ref.setTranslation(Eigen::Vector3d::Zero());
  }
  return starts;
}

Alignment CoarseInitializer::bestStart(const Frame& frame, const std::vector<Alignment>& starts) {
  const int coarsest = static_cast<int>(attempt_.levels.size()) - 1;
  const auto view = viewOf(frame, camera_, coarsest);
  PointLevel& points = attempt_.levels.back();
  points.trial_inverse_depth = points.inverse_depth;
  return leastOf(starts, [&](const Alignment& alignment) {
    return aligner_.evaluate(view, Unknowns::kPose, points, alignment)
        .sums.robustEnergy(points.size());
  });
}

LevelReport CoarseInitializer::track(const FramePtr& frame) {
  std::vector<PointLevel>& levels = attempt_.levels;
  const bool was_snapped = attempt_.frames.back().alignment.snapped;
  if (!was_snapped) {
    for (PointLevel& level : levels) flatten(level);
  }
  const AlignedFrame& last = attempt_.frames.back();
  AlignedFrame next{frame, {}, {}};
  next.alignment = bestStart(*frame, startValues(*frame, last.alignment, last_motion_));
  if (!options_.coarse.published) {
    const RotationMatch match =
        rotation_search_.find(viewOf(*frame, camera_, static_cast<int>(levels.size()) - 1),
                              startValues(*frame, last.rotation, last_motion_));
    next.rotation = match.rotation;
    if (match.matches && !was_snapped) next.alignment = match.rotation;
  }
  Estimate estimate{std::move(attempt_.levels), next.alignment, {}};
  const AlignmentTask task{*frame, camera_, options_.coarse, aligner_};
  converge(task, {kMatchShare, HUGE_VAL}, estimate);
  attempt_.levels = std::move(estimate.levels);
  next.alignment = estimate.alignment;
  ++tracked_;
  if (options_.coarse.published) {
    next.rotation = next.alignment;
    next.rotation.T_cur_ref.setTranslation(Eigen::Vector3d::Zero());
  }
  last_motion_ = next.alignment.T_cur_ref * last.alignment.T_cur_ref.inverse();
  attempt_.frames.push_back(next);
  if (next.alignment.snapped) confirmSnap();
  return estimate.finest;
}

void CoarseInitializer::confirmSnap() {
  AlignedFrame& newest = attempt_.frames.back();
  if (snapped_since_ == 0 && options_.coarse.min_snap_gain > 0) {
    const RotationTest test = testRotation(attempt_, aligner_);
    if (test.motion_gain < options_.coarse.min_snap_gain) {
      newest.alignment = newest.rotation = test.rotation;
      return;
    }
  }
  if (snapped_since_ == 0) snapped_since_ = tracked_;
}

/// A later frame would tell depths better; but it may also be lost.
bool CoarseInitializer::waitsForParallax() const {
  return tracked_ <= snapped_since_ + kMaxSettleFrames &&
         parallaxDeg(attempt_) < options_.coarse.wanted_parallax_deg;
}

InitStep CoarseInitializer::assess(const LevelReport& finest) {
  const CoarseOptions& o = options_.coarse;
  const AlignedFrame newest = attempt_.frames.back();
  const bool tests = o.max_outlier_share < 1;
  const double cut_share = kMaxInlierDrop * std::exchange(inlier_share_, finest.inlierShare());
  if (tests && inlier_share_ < std::max(1.0 - o.max_outlier_share, cut_share)) {
    return startOver(newest.frame, InitReason::kTrackingLost, true);
  }
  if (tests && finest.visibleShare() < kMinVisibleShare) {
    // Without parallax nothing is lost but old frames: the camera has turned away.
    return newest.alignment.snapped
               ? startOver(newest.frame, InitReason::kTrackingLost, true)
               : startOver(newest.frame, InitReason::kTooLittleParallax, false);
  }
  InitReason reason = InitReason::kTooLittleParallax;
  if (newest.alignment.snapped) {
    reason = InitReason::kSettling;
    if (tracked_ > snapped_since_ + o.settle_frames && !waitsForParallax()) {
      InitStep step = conclude(finest);
      if (step.result) return step;
      reason = step.reason;
    }
  }
  refusals_ = reason == InitReason::kPoorQuality ? refusals_ + 1 : 0;
  if (refusals_ >= kMaxRefusals) return startOver(newest.frame, reason, true);
  if (o.max_frames > 0 && tracked_ + 1 >= o.max_frames) {
    const bool parallax = newest.alignment.snapped && reason != InitReason::kTooLittleParallax &&
                          reason != InitReason::kDegenerateMotion;
    return startOver(newest.frame, parallax ? InitReason::kTimeout : reason, parallax);
  }
  if (attempt_.frames.size() >
      std::min(waitingFrames(*newest.frame, options_.max_waiting_mb), kKeptFrames)) {
    const std::size_t dropped = leastMissed(
        attempt_.frames, [](const AlignedFrame& f) -> const Frame& { return *f.frame; });
    attempt_.frames.erase(attempt_.frames.begin() + static_cast<std::ptrdiff_t>(dropped));
  }
  return needsMoreFrames(reason);
}

double CoarseInitializer::challenge(const LevelReport& finest) {
  AlignedFrame& newest = attempt_.frames.back();
  const AlignmentTask task{*newest.frame, camera_, options_.coarse, aligner_};
  Contest result =
      contest(task, newest.rotation, Estimate{attempt_.levels, newest.alignment, finest});
  attempt_.levels = std::move(result.winner.levels);
  newest.alignment = result.winner.alignment;
  return result.margin;
}

InitStep CoarseInitializer::conclude(const LevelReport& finest) {
  const CoarseOptions& o = options_.coarse;
  Quality quality = clock_.time("quality", [&] { return judge(attempt_, aligner_); });
  // An estimate of poor quality may still be improved by a rival. After one refusal the rivals,
  // which take a quarter of a second, are not tried again.
  const bool contested = quality.reason == InitReason::kDone ||
                         (quality.reason != InitReason::kTooLittleParallax && refusals_ == 0);
  if (contested && o.min_rival_margin > 0) {
    const double margin = clock_.time("rivals", [&] { return challenge(finest); });
    quality = clock_.time("quality", [&] { return judge(attempt_, aligner_); });
    quality.rival_margin = margin;
    if (quality.reason == InitReason::kDone && margin < o.min_rival_margin) {
      quality.reason = InitReason::kDegenerateMotion;
    }
  }
  if (quality.reason != InitReason::kDone) return needsMoreFrames(quality.reason);
  InitStep step = resets_.finish(handOver(attempt_, quality, aligner_), clock_);
  done_ = true;
  attempt_ = CoarseAttempt{};
  return step;
}

InitStep CoarseInitializer::startOver(const FramePtr& frame, InitReason reason, bool lost) {
  setReference(frame);
  if (!lost) return needsMoreFrames(reason);
  last_motion_ = SE3();
  return resets_.restart(reason);
}

}  // namespace dsorb::init_coarse
