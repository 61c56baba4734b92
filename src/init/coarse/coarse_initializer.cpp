// SPDX-License-Identifier: BSD-3-Clause
#include "init/coarse/coarse_initializer.h"

#include "base/angles.h"
#include "base/median.h"
#include "base/parallel.h"
#include "base/random.h"
#include "estimate/marginals.h"
#include "image/cell_grid.h"
#include "image/frame_check.h"
#include "image/photometric.h"
#include "image/pixel_selector.h"
#include "init/reset_log.h"
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
constexpr double kUnknownVariance = 1;  // of an inverse depth the newest frame does not tell

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

/// Coarse-to-fine alignment at the depths of `levels`, those of points that are good in `all`.
/// @return report of the finest level
LevelReport alignFrame(const AlignmentTask& task,
                       Unknowns unknowns,
                       const std::vector<PointLevel>& all,
                       std::vector<PointLevel>& levels,
                       Alignment& alignment) {
  LevelReport report;
  for (std::size_t l = levels.size(); l-- > 0;) {
    levels[l].good = all[l].good;
    const LevelView view = viewOf(task.frame, task.camera, static_cast<int>(l));
    report = task.aligner.align(view, kPoseIterations[l], unknowns, levels[l], alignment);
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

/// Mean squared residual of the good points of level 0 [grey levels^2].
double residualVariance(const LevelState& state) {
  return energyPerPoint(state) / kPatternSize;
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

struct RotationMatch {
  Alignment rotation;
  bool matches = false;  // the images do, nearly everywhere in view: it may well be the motion
};

/// Finds the pure rotation that explains a frame best, on the coarsest level alone: from the best
/// of the given starts, or, where the images do not match from there, from a grid of rotations
/// around it.
class RotationSearch {
 public:
  explicit RotationSearch(const CoarseOptions& options) : aligner_(options) {}

  /// @param points coarsest level of the reference
  void setReference(const PointLevel& points) { points_ = points; }

  /// @param starts at least one; their translations are left out
  RotationMatch find(const LevelView& coarsest, std::vector<Alignment> starts) {
    for (Alignment& start : starts) {
      start.T_cur_ref.setTranslation(Eigen::Vector3d::Zero());
      start.snapped = false;
    }
    const Alignment start = best(coarsest, starts);
    Alignment near = start;
    if (refine(coarsest, near) >= kMinMatchShare) return {near, true};
    Alignment far = best(coarsest, gridAround(start, coarsest.camera));
    const bool matches = refine(coarsest, far) >= kMinMatchShare;
    return matches ? RotationMatch{far, true} : RotationMatch{best(coarsest, {near, far}), false};
  }

 private:
  /// Points out of view or far off count as outliers.
  Alignment best(const LevelView& view, const std::vector<Alignment>& candidates) {
    return leastOf(candidates, [&](const Alignment& candidate) {
      std::fill(points_.good.begin(), points_.good.end(), std::uint8_t{1});
      return aligner_.evaluate(view, Unknowns::kRotation, points_, candidate)
          .sums.robustEnergy(points_.size());
    });
  }
  /// @return share of the points in view that match
  double refine(const LevelView& view, Alignment& alignment) {
    std::fill(points_.good.begin(), points_.good.end(), std::uint8_t{1});
    return aligner_.align(view, kRotationIterations, Unknowns::kRotation, points_, alignment)
        .inlierShare();
  }

  LevelAligner aligner_;
  PointLevel points_;
};

constexpr float kSelectionFactor = 2;      // on the selector's thresholds, level 0
constexpr int kFirstGridSpacing = 5;       // of the grid maxima, levels from 1 [px]
constexpr int kMinPoints = 100;            // of level 0, else the frame is no reference
constexpr double kMinSpread = 0.02;        // of them across their main direction [diagonals]
constexpr double kMinVisibleShare = 0.25;  // points in view, else the reference is too far away
constexpr int kMaxSettleFrames = 5;        // to wait for the wanted parallax; as published
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

/// Log of the ratio of exposures, new to reference; 0 when one is unknown.
double logExposureRatio(const Frame& reference, const Frame& frame) {
  return std::log(brightnessTransfer({}, reference.exposure(), {}, frame.exposure()).gain);
}

/// Whether the newest frame is a fit end of the attempt.
struct Quality {
  InitReason reason = InitReason::kDone;  // kDone, or what is missing
  double parallax_deg = 0;                // median, rotation-compensated
  double relative_sigma = 0;              // median of the good points of level 0
  double rival_margin = 0;  // energy of the best motion elsewhere over its own, less 1
};

/// The best pure rotation against the estimate of the newest frame.
struct RotationTest {
  LevelState full;         // of the estimate
  double motion_gain = 0;  // share of the energy of the rotation that translation removes
};

/// Direct initializer: aligns each new frame with the first one, pose, brightness and the inverse
/// depths of the first frame's points together, coarse to fine. A prior holds translation and
/// depths until the images explain a motion well enough ("snap"); after some more frames it hands
/// over.
/// @source front end of DSO as published with Engel et al., arXiv:1607.02565
class CoarseInitializer final : public Initializer {
 public:
  CoarseInitializer(const InitializerOptions& options, const PinholeCamera& camera)
      : options_(options),
        o_(options_.coarse),
        camera_(camera),
        arena_(options.num_threads),
        frame_check_(camera),
        aligner_(options.coarse),
        rotation_search_(options.coarse) {}

  [[nodiscard]] InitStep addFrame(FramePtr frame) override {
    if (done_) throw std::logic_error("addFrame after a result: call reset() first");
    frame_check_.accept(frame);
    return arena_.run([&]() -> InitStep {
      if (frames_.empty()) {
        const bool enough = setReference(frame);
        return needsMoreFrames(enough ? InitReason::kFirstFrame : InitReason::kTooFewPoints);
      }
      return assess(clock_.time("alignment", [&] { return track(frame); }));
    });
  }

  void reset() override {
    clock_.clear();
    clear();
    done_ = false;
    resets_.clear();
    frame_check_.restart();
    last_motion_ = SE3();
  }

 private:
  void clear() {
    frames_.clear();
    levels_.clear();
    snapped_since_ = tracked_ = 0;
  }

  /// Makes the frame the first one.
  /// @return false when it has too few points
  bool setReference(const FramePtr& frame) {
    clear();
    levels_ = clock_.time("points", [&] { return selectPoints(*frame, o_, options_.seed); });
    const PointLevel& finest = levels_.front();
    const double diagonal = std::hypot(frame->width(), frame->height());
    if (finest.size() < kMinPoints || spreadAcross(finest) < kMinSpread * diagonal) return false;
    Alignment still;
    still.balanced = !o_.published;
    frames_.push_back({frame, still, still});
    rotation_search_.setReference(levels_.back());
    return true;
  }

  [[nodiscard]] AlignmentTask taskOf(const Frame& frame) { return {frame, camera_, o_, aligner_}; }
  [[nodiscard]] LevelView coarsestOf(const Frame& frame) const {
    return viewOf(frame, camera_, static_cast<int>(levels_.size()) - 1);
  }

  /// The estimate of the last frame, and what it becomes by the last relative motion.
  [[nodiscard]] std::vector<Alignment> startValues(const Frame& frame,
                                                   const Alignment& last) const {
    Alignment start = last;
    const Frame& reference = *frames_.front().frame;
    const double log_ratio = logExposureRatio(reference, frame);
    start.exposure_log_gain = log_ratio;
    std::vector<Alignment> starts;
    if (o_.published) {
      start.log_gain = log_ratio;
      start.offset = 0;
      starts = {start};
    } else {
      start.log_gain += log_ratio - logExposureRatio(reference, *frames_.back().frame);
      starts = {start, start};
      starts.back().T_cur_ref = last_motion_ * start.T_cur_ref;
    }
    if (!start.snapped) {
      for (Alignment& value : starts) value.T_cur_ref.setTranslation(Eigen::Vector3d::Zero());
    }
    return starts;
  }

  /// The start that fits the coarsest level better.
  [[nodiscard]] Alignment bestStart(const Frame& frame, const std::vector<Alignment>& starts) {
    PointLevel& points = levels_.back();
    points.trial_inverse_depth = points.inverse_depth;
    return leastOf(starts, [&](const Alignment& alignment) {
      return aligner_.evaluate(coarsestOf(frame), Unknowns::kPose, points, alignment)
          .sums.robustEnergy(points.size());
    });
  }

  /// Aligns the newest frame on all levels; the report is that of the finest.
  LevelReport track(const FramePtr& frame) {
    const AlignedFrame last = frames_.back();
    if (!last.alignment.snapped) {
      for (PointLevel& level : levels_) flatten(level);
    }
    AlignedFrame next{frame, {}, {}};
    next.alignment = bestStart(*frame, startValues(*frame, last.alignment));
    if (!o_.published) {
      const RotationMatch match =
          rotation_search_.find(coarsestOf(*frame), startValues(*frame, last.rotation));
      next.rotation = match.rotation;
      if (match.matches && !last.alignment.snapped) next.alignment = match.rotation;
    }
    Estimate estimate{std::move(levels_), next.alignment, {}};
    converge(taskOf(*frame), {kMatchShare, HUGE_VAL}, estimate);
    levels_ = std::move(estimate.levels);
    next.alignment = estimate.alignment;
    ++tracked_;
    if (o_.published) {
      next.rotation = next.alignment;
      next.rotation.T_cur_ref.setTranslation(Eigen::Vector3d::Zero());
    }
    last_motion_ = next.alignment.T_cur_ref * last.alignment.T_cur_ref.inverse();
    frames_.push_back(next);
    if (next.alignment.snapped && snapped_since_ == 0) snapped_since_ = tracked_;
    return estimate.finest;
  }

  [[nodiscard]] RotationTest testRotation() {
    std::vector<PointLevel> fixed = fixedLevels(levels_);
    const AlignedFrame& newest = frames_.back();
    RotationTest test;
    Alignment rotation = newest.rotation;
    test.full = aligner_.evaluate(
        viewOf(*newest.frame, camera_, 0), Unknowns::kPose, fixed.front(), newest.alignment);
    const LevelReport still =
        alignFrame(taskOf(*newest.frame), Unknowns::kRotation, levels_, fixed, rotation);
    test.motion_gain = 1.0 - energyPerPoint(test.full) / energyPerPoint(still.state);
    return test;
  }

  /// Median angle between the rays to the good points from the reference and the newest frame.
  [[nodiscard]] double parallaxDeg() const {
    const PointLevel& points = levels_.front();
    const SE3& T = frames_.back().alignment.T_cur_ref;
    std::vector<double> angles;
    for (std::size_t i = 0; i < points.x.size(); ++i) {
      if (points.good[i] == 0) continue;
      const Eigen::Vector3d ray =
          T.unitQuaternion() * camera_.unproject({points.x[i], points.y[i]});
      const Eigen::Vector3d moved = ray + static_cast<double>(points.smoothed[i]) * T.translation();
      angles.push_back(angleDeg(ray, moved));
    }
    return medianOf(std::move(angles));
  }

  /// A later frame would tell depths better; but it may also be lost.
  [[nodiscard]] bool waitsForParallax() const {
    return tracked_ <= snapped_since_ + kMaxSettleFrames && parallaxDeg() < o_.wanted_parallax_deg;
  }

  InitStep assess(const LevelReport& finest) {
    const AlignedFrame newest = frames_.back();
    const bool tests = o_.max_outlier_share < 1;
    if (tests && finest.inlierShare() < 1.0 - o_.max_outlier_share) {
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
      if (tracked_ > snapped_since_ + o_.settle_frames && !waitsForParallax()) {
        InitStep step = conclude(finest);
        if (step.result) return step;
        reason = step.reason;
      }
    }
    if (o_.max_frames > 0 && tracked_ + 1 >= o_.max_frames) {
      const bool parallax = newest.alignment.snapped && reason != InitReason::kTooLittleParallax &&
                            reason != InitReason::kDegenerateMotion;
      return startOver(newest.frame, parallax ? InitReason::kTimeout : reason, parallax);
    }
    if (frames_.size() >
        std::min(waitingFrames(*newest.frame, options_.max_waiting_mb), kKeptFrames)) {
      const std::size_t dropped =
          leastMissed(frames_, [](const AlignedFrame& f) -> const Frame& { return *f.frame; });
      frames_.erase(frames_.begin() + static_cast<std::ptrdiff_t>(dropped));
    }
    return needsMoreFrames(reason);
  }

  /// Drops everything before the frame. @param lost everything is wrong, not just old
  InitStep startOver(const FramePtr& frame, InitReason reason, bool lost) {
    setReference(frame);
    if (!lost) return needsMoreFrames(reason);
    last_motion_ = SE3();
    return resets_.restart(reason);
  }

  /// Judges an attempt that has settled.
  [[nodiscard]] Quality judge() {
    Quality quality;
    quality.parallax_deg = parallaxDeg();
    if (quality.parallax_deg < o_.min_parallax_deg) {
      quality.reason = InitReason::kTooLittleParallax;
      return quality;
    }
    const RotationTest test = testRotation();
    const PointLevel& points = levels_.front();
    std::vector<double> sigmas;
    for (std::size_t i = 0; i < points.x.size(); ++i) {
      if (points.good[i] == 0) continue;
      const double curvature = std::max(static_cast<double>(points.curvature[i]), 1.0);
      sigmas.push_back(std::sqrt(residualVariance(test.full) / curvature) /
                       static_cast<double>(points.smoothed[i]));
    }
    quality.relative_sigma = medianOf(std::move(sigmas));
    if (test.motion_gain < o_.min_motion_gain) {
      quality.reason = InitReason::kDegenerateMotion;
    } else if (1.0 - test.full.sums.inlierShare() > o_.max_outlier_share) {
      quality.reason = InitReason::kPoorQuality;
    }
    return quality;
  }

  /// Lets motions in other directions compete with the estimate and takes over the best.
  /// @return margin of the contest
  double challenge(const LevelReport& finest) {
    AlignedFrame& newest = frames_.back();
    Contest result =
        contest(taskOf(*newest.frame), newest.rotation, {levels_, newest.alignment, finest});
    levels_ = std::move(result.winner.levels);
    newest.alignment = result.winner.alignment;
    return result.margin;
  }

  InitStep conclude(const LevelReport& finest) {
    Quality quality = clock_.time("quality", [&] { return judge(); });
    if (quality.reason == InitReason::kDone && o_.min_rival_margin > 0) {
      const double margin = clock_.time("rivals", [&] { return challenge(finest); });
      quality = clock_.time("quality", [&] { return judge(); });  // the winner may be another one
      quality.rival_margin = margin;
      if (quality.reason == InitReason::kDone && margin < o_.min_rival_margin) {
        quality.reason = InitReason::kDegenerateMotion;
      }
    }
    if (quality.reason != InitReason::kDone) return needsMoreFrames(quality.reason);
    InitStep step = resets_.finish(handOver(quality), clock_);
    done_ = true;
    clear();
    return step;
  }

  /// Aligns every frame to the final inverse depths and gathers the result, scaled and checked.
  [[nodiscard]] InitializationResult handOver(const Quality& quality) {
    InitializationResult result;
    result.frames = poseFrames();
    result.points = makePoints();
    normalizeScale(result);
    InitReport& report = result.report;
    report.model = "direct";
    report.median_relative_sigma = quality.relative_sigma;
    report.wrong_probability = wrongProbability(result.frames.back(), quality);
    report.add("parallax_deg", quality.parallax_deg);
    return result;
  }

  /// Probability that the newest frame's direction is wrong, by its own errors or because a motion
  /// elsewhere is the right one; nothing where one of them was not looked at.
  [[nodiscard]] std::optional<double> wrongProbability(const PosedFrame& newest,
                                                       const Quality& quality) const {
    if (o_.published || !(o_.min_rival_margin > 0) || !newest.covariance) return std::nullopt;
    const double errors = tailProbability(kDirectionScale * directionSigmasDeg(newest),
                                          options_.orb.gate.wrong_angle_deg);
    const double rival =
        rivalProbability(1.0 + std::min(quality.rival_margin, kTellingMargin), kRivalSamples);
    return 1 - (1 - errors) * (1 - rival);
  }

  /// Poses of all frames at the final inverse depths, the newest first: each other one starts on
  /// the way from the reference to the one after it.
  [[nodiscard]] std::vector<PosedFrame> poseFrames() {
    const Frame& reference = *frames_.front().frame;
    std::vector<PosedFrame> posed(frames_.size());
    posed.front() = {frames_.front().frame, SE3(), {}, std::nullopt};
    std::vector<PointLevel> fixed = fixedLevels(levels_);
    for (std::size_t k = frames_.size() - 1; k > 0; --k) {
      const Frame& frame = *frames_[k].frame;
      Alignment alignment = frames_[k].alignment;
      if (k + 1 < frames_.size()) {
        const double fraction = static_cast<double>(k) / static_cast<double>(k + 1);
        alignment.T_cur_ref = SE3::exp(fraction * posed[k + 1].T_cam_ref->log());
      }
      alignFrame(taskOf(frame), Unknowns::kPose, levels_, fixed, alignment);
      posed[k].frame = frames_[k].frame;
      posed[k].T_cam_ref = alignment.T_cur_ref;
      posed[k].affine = {alignment.log_gain - logExposureRatio(reference, frame), alignment.offset};
      const auto uncertainty =
          uncertaintyOf({frames_[k].frame, alignment, {}}, camera_, fixed.front(), aligner_);
      if (uncertainty) posed[k].covariance = uncertainty->pose;
    }
    return posed;
  }

  [[nodiscard]] std::vector<InitPoint> makePoints() {
    const PointLevel& points = levels_.front();
    PointLevel fixed = points;
    fixed.trial_inverse_depth = fixed.inverse_depth = fixed.smoothed;
    const auto uncertainty = uncertaintyOf(frames_.back(), camera_, fixed, aligner_);
    std::vector<InitPoint> result;
    for (const std::size_t i : o_.published ? randomPoints() : spreadPoints()) {
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

  /// Indices of some points, whether they were seen well or not, ascending.
  [[nodiscard]] std::vector<std::size_t> randomPoints() const {
    const PointLevel& points = levels_.front();
    const double share = static_cast<double>(kHandoverPoints) / points.size();
    Random random(static_cast<std::uint64_t>(options_.seed));
    std::vector<std::size_t> kept;
    for (std::size_t i = 0; i < points.x.size(); ++i) {
      if (random.uniform() < share) kept.push_back(i);
    }
    return kept;
  }

  /// The point of the largest curvature that the newest frame sees well in each cell of a grid with
  /// as many cells as points wanted.
  [[nodiscard]] std::vector<std::size_t> spreadPoints() const {
    const PointLevel& points = levels_.front();
    const double area = static_cast<double>(camera_.width) * camera_.height;
    const CellGrid cells(camera_.width, camera_.height, std::sqrt(area / kHandoverPoints));
    std::vector<std::size_t> fit;
    for (std::size_t i = 0; i < points.x.size(); ++i) {
      if (points.good[i] != 0 && points.energy[i] <= kPatternOutlierEnergy) fit.push_back(i);
    }
    return bestOfCells(
        cells,
        fit,
        [&](std::size_t i) { return Eigen::Vector2f(points.x[i], points.y[i]); },
        [&](std::size_t a, std::size_t b) { return points.curvature[a] > points.curvature[b]; });
  }

  InitializerOptions options_;
  const CoarseOptions& o_;
  PinholeCamera camera_;
  TaskArena arena_;
  FrameCheck frame_check_;
  LevelAligner aligner_;
  RotationSearch rotation_search_;

  // The attempt: front frame the reference, back frame the newest.
  std::vector<AlignedFrame> frames_;
  std::vector<PointLevel> levels_;  // finest first, as the newest frame left them
  StageClock clock_;
  int snapped_since_ = 0;  // frames tracked up to the one that snapped, 0: not yet
  int tracked_ = 0;        // frames since the reference
  bool done_ = false;
  ResetLog resets_;
  SE3 last_motion_;  // from the frame before the newest to the newest
};

}  // namespace

std::optional<Uncertainty> uncertaintyOf(const AlignedFrame& tracked,
                                         const PinholeCamera& camera,
                                         PointLevel& points,
                                         LevelAligner& aligner) {
  const LevelState state = aligner.evaluate(
      viewOf(*tracked.frame, camera, 0), Unknowns::kPose, points, tracked.alignment);
  LinearSystem<double> system(aligner.evaluated());
  std::vector<double> depths(points.x.size(), 0.0);
  std::vector<std::size_t> known;
  for (std::size_t i = 0; i < points.x.size(); ++i) {
    const float curvature = points.trial_good[i] != 0 ? points.trial_curvature[i] : 0.0F;
    system.depth_hessian[i] = curvature < kMinCurvature ? 0 : static_cast<double>(curvature);
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

std::unique_ptr<Initializer> makeCoarseInitializer(const InitializerOptions& options,
                                                   const PinholeCamera& camera) {
  return std::make_unique<CoarseInitializer>(options, camera);
}

}  // namespace dsorb::init_coarse
