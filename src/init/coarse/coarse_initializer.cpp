// SPDX-License-Identifier: BSD-3-Clause
#include "init/coarse/coarse_initializer.h"

#include "base/parallel.h"
#include "image/pixel_selector.h"
#include "init/coarse/coarse_handover.h"
#include "init/waiting_frames.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <stdexcept>
#include <utility>

namespace dsorb::init_coarse {
namespace {

constexpr std::array<int, 5> kIterations = {5, 5, 10, 30, 50};  // per level, finest first
constexpr int kScreenIterations = 15;  // on the coarsest level, of every hypothesis
constexpr std::size_t kFinalists = 2;  // aligned on all levels
constexpr double kTranslation = 0.1;   // of a hypothesis, in units of the mean depth
constexpr std::size_t kRivals = 3;     // of an estimate, aligned on all levels
constexpr double kConverged = 0.98;    // of the energy left by a pass: the next one would not help
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

std::vector<Alignment> hypotheses(const Alignment& rotation) {
  std::vector<Alignment> result;
  for (int axis = 0; axis < 3; ++axis) {
    for (const double sign : {-1.0, 1.0}) {
      result.push_back(hypothesis(rotation, sign * kTranslation * Eigen::Vector3d::Unit(axis)));
    }
  }
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

std::optional<Estimate> betterHypothesis(const AlignmentTask& task,
                                         const Alignment& rotation,
                                         const Estimate& given) {
  const int top = static_cast<int>(given.levels.size()) - 1;
  const LevelView coarsest = viewOf(task.frame, task.camera, top);
  std::vector<std::pair<double, Alignment>> screened;
  for (const Alignment& start : hypotheses(rotation)) {
    PointLevel points = given.levels.back();
    restart(points);
    Alignment alignment = start;
    const LevelReport report =
        task.aligner.align(coarsest, kScreenIterations, Unknowns::kAll, points, alignment);
    screened.emplace_back(robustEnergy(report), start);
  }
  std::stable_sort(screened.begin(), screened.end(), [](const auto& a, const auto& b) {
    return a.first < b.first;
  });
  std::vector<Estimate> finalists;
  for (std::size_t i = 0; i < std::min(kFinalists, screened.size()); ++i) {
    finalists.push_back({given.levels, screened[i].second, {}});
    for (PointLevel& level : finalists.back().levels) restart(level);
  }
  forEachOf(finalists, 0, task, [](const AlignmentTask& own, Estimate& trial) {
    alignLevels(own, 0, trial);
  });
  sortByEnergy(finalists);
  if (finalists.empty() || !(finalists.front().energy() < given.energy())) return std::nullopt;
  return std::move(finalists.front());
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
  double least = HUGE_VAL;
  Alignment result = candidates.front();
  for (const Alignment& candidate : candidates) {
    const double value = energy(view, candidate);
    if (value < least) {
      least = value;
      result = candidate;
    }
  }
  return result;
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
  const auto energy = [&](const Alignment& alignment) {
    return aligner_.evaluate(view, Unknowns::kPose, points, alignment)
        .sums.robustEnergy(points.size());
  };
  return starts.size() == 2 && energy(starts[1]) < energy(starts[0]) ? starts[1] : starts[0];
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
  if (!options_.coarse.published && snapped_since_ == 0 && estimate.alignment.snapped) {
    if (auto better = betterHypothesis(task, next.rotation, estimate)) {
      estimate = std::move(*better);
    }
  }
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
