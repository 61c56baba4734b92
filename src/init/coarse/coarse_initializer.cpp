// SPDX-License-Identifier: BSD-3-Clause
#include "init/coarse/coarse_initializer.h"

#include "image/pixel_selector.h"
#include "init/waiting_frames.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

namespace dsorb::init_coarse {
namespace {

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
