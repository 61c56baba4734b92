// SPDX-License-Identifier: BSD-3-Clause
#include "track/tracker.h"

#include "image/contrast.h"
#include "track/tracking_covariance.h"

#include <cmath>
#include <limits>
#include <stdexcept>

namespace dsorb::track {
namespace {

// Front end of DSO as published.
constexpr std::array<int, kTrackingLevels> kMaxIterations = {10, 20, 50, 50, 50};
constexpr double kAbortFactor = 1.5;   // a hypothesis ends at a level worse than this x the best
constexpr double kAcceptFactor = 1.5;  // the search ends below this x the previous frame's rmse
constexpr double kMaxAbsoluteLogGain = 1.2;
constexpr double kMaxRelativeLogGain = 1.5;
constexpr double kMaxOffset = 200;  // [grey levels]

// Evidence for the limits of TrackerOptions.
//
// min_inside_fraction: true poses were tracked to 0.2 deg and 0.005 units on TartanAir hospital
// down to 0.33.
//
// max_rmse: measured against the initial map alone. KITTI 00 after ORBInitializer, 5 starts: up to
// 13.9 path errors stay at 2 to 4 % where they began so, at 13.9 a first pose is wrong by 2 deg;
// 12, 13, 14 track 5, 10, 16 frames in the median. Synthetic street with true depths: 7 % at 13,
// 20 % at 14. TartanAir hospital: a first wrong pose at 13.0.
//
// max_gain_step: wrong poses lower their residual by lowering contrast. Without this bound, on
// TartanAir hospital, the gain fell by 0.4 to 0.7 in the frame where tracking failed and rotation
// errors up to 23 deg went unnoticed. A step of the exposure shows in the distribution of the grey
// levels as well: at a tracked pose its gain differs by 0.01 from the one found, at the guess by
// 0.1 (room_hand).

/// Keeps the smaller value of each level; an unset value gives way to a set one.
void lower(LevelRmse& bounds, const LevelRmse& rmse) {
  for (std::size_t l = 0; l < bounds.size(); ++l) {
    if (rmse[l] < bounds[l] || std::isnan(bounds[l])) bounds[l] = rmse[l];
  }
}

/// What is known of the rows' motion; nothing with a global shutter.
std::optional<RowsOfFrame> rowsOf(const Frame& frame, const TrackingStart& known) {
  if (!isRolling(frame)) return std::nullopt;
  return RowsOfFrame{frame.timestamp(), known.recent, known.velocity_sigma};
}

}  // namespace

/// What is known of the brightness, the most likely first: that of the previous frame, unless the
/// grey levels have changed by more than that may.
std::vector<AffineBrightness> Tracker::brightnessGuesses(const Frame& frame,
                                                         const TrackingStart& start,
                                                         const GreyComparison& grey) const {
  if (brightness_ == BrightnessModel::kPerfect) return {AffineBrightness{}};
  if (!compare_grey_) return {start.affine};
  const std::optional<BrightnessTransfer> transfer = grey.transfer();
  if (!transfer) return {start.affine};
  const AffineBrightness& from = reference_.affine;
  const double known =
      brightnessTransfer(from, reference_.frame->exposure(), {}, frame.exposure()).gain;
  const AffineBrightness measured{std::log(transfer->gain / known),
                                  transfer->offset + transfer->gain * from.b};
  if (std::abs(measured.a - start.affine.a) <= start.max_gain_step) return {start.affine};
  return {measured, start.affine};
}

/// Brightness transfer from the reference to the frame.
BrightnessTransfer Tracker::transferTo(const Frame& frame, const AffineBrightness& affine) const {
  return brightnessTransfer(
      reference_.affine, reference_.frame->exposure(), affine, frame.exposure());
}

bool Tracker::isPlausible(const AffineBrightness& affine, const Frame& frame) const {
  if (brightness_ == BrightnessModel::kUncalibrated) {
    const BrightnessTransfer transfer = transferTo(frame, affine);
    return std::abs(std::log(transfer.gain)) <= kMaxRelativeLogGain &&
           std::abs(transfer.offset) <= kMaxOffset;
  }
  return std::abs(affine.a) <= kMaxAbsoluteLogGain && std::abs(affine.b) <= kMaxOffset;
}

/// Whether the gain agrees with the previous frame's or with what the grey levels say.
bool Tracker::isSupported(const AlignmentState& state,
                          const Frame& frame,
                          const TrackingStart& start) const {
  if (brightness_ == BrightnessModel::kPerfect) return true;
  if (std::abs(state.affine.a - start.affine.a) <= start.max_gain_step) return true;
  if (!compare_grey_) return false;
  const GreyComparison grey(reference_, frame, state.T_cur_ref);
  return grey.misfit(transferTo(frame, state.affine)) <= start.max_gain_step;
}

Tracker::Descent Tracker::descend(const Frame& frame,
                                  const AlignmentState& start,
                                  const TrackingStart& known,
                                  const LevelRmse& bounds) {
  Descent descent;
  descent.state = start;
  descent.failure = TrackingFailure::kDiverged;
  const std::optional<RowsOfFrame> rows = rowsOf(frame, known);
  if (rows) descent.state.motion = rows->predict(start.T_cur_ref);
  bool repeated = false;
  for (int level = reference_.levels() - 1; level >= 0; --level) {
    const auto l = static_cast<std::size_t>(level);
    if (rows) {
      descent.state.motion.acceleration = rows->predict(descent.state.T_cur_ref).acceleration;
    }
    const LevelResult result =
        alignment_.align({reference_, frame, level, ceiling_, rows ? &*rows : nullptr},
                         kMaxIterations[l],
                         descent.state);
    descent.rmse[l] = result.rmse;
    descent.noise = result.noise;
    descent.equations = result.equations;
    descent.inside_fraction = result.inside_fraction;
    if (!std::isfinite(result.rmse) || result.rmse > kAbortFactor * bounds[l]) {
      return descent;
    }
    if (result.cutoff_raised && !repeated) {
      repeated = true;
      ++level;
    }
  }
  if (!isPlausible(descent.state.affine, frame)) {
    descent.failure = TrackingFailure::kBrightness;
  } else if (descent.inside_fraction < options_.min_inside_fraction) {
    descent.failure = TrackingFailure::kTooFewInside;
  } else {
    descent.failure = TrackingFailure::kNone;
  }
  return descent;
}

void Tracker::search(const Frame& frame,
                     const TrackingStart& start,
                     const AffineBrightness& affine,
                     TrackingResult& best) {
  for (const SE3& guess : start.guesses) {
    Descent descent = descend(frame, {guess, affine}, start, best.rmse);
    if (descent.failure == TrackingFailure::kNone && !isSupported(descent.state, frame, start)) {
      descent.failure = TrackingFailure::kBrightness;
    }
    ++best.hypotheses_tried;
    if (descent.failure == TrackingFailure::kNone && !(descent.rmse[0] >= best.rmse[0])) {
      best.failure = TrackingFailure::kNone;
      best.T_cur_ref = descent.state.T_cur_ref;
      best.affine = descent.state.affine;
      best.motion = descent.state.motion;
      best.covariance = trackingCovariance(descent.equations,
                                           varianceOfResiduals(descent.rmse[0], descent.noise),
                                           descent.state.T_cur_ref,
                                           brightness_);
      best.inside_fraction = descent.inside_fraction;
    } else if (best.hypotheses_tried == 1) {
      best.failure = descent.failure;
      best.inside_fraction = descent.inside_fraction;
    }
    if (descent.failure != TrackingFailure::kNone) continue;
    lower(best.rmse, descent.rmse);
    if (best.rmse[0] < kAcceptFactor * start.previous_rmse) break;
  }
}

TrackingResult Tracker::track(const Frame& frame, const TrackingStart& start) {
  if (reference_.frame == nullptr) throw std::logic_error("Tracker::track before setReference");
  TrackingResult best;
  best.T_cur_ref = start.guesses.at(0);
  if (isBlank(frame, *reference_.frame)) {
    best.failure = TrackingFailure::kBlank;
    return best;
  }
  const GreyComparison grey(reference_, frame, start.guesses.at(0));
  const std::vector<AffineBrightness> guesses = brightnessGuesses(frame, start, grey);
  // What is clipped in both images agrees; in a much brighter frame it would pull the gain down.
  const bool brighter = std::log(transferTo(frame, guesses.front()).gain) > start.max_gain_step;
  ceiling_ = brighter ? grey.ceiling() : std::numeric_limits<float>::infinity();
  for (const AffineBrightness& affine : guesses) {
    if (!best.good()) search(frame, start, affine, best);
  }
  if (!best.good()) return best;
  best.flow = flowIndicators(reference_.at(0), reference_.camera, best.T_cur_ref);
  if (best.rmse[0] > options_.max_rmse) best.failure = TrackingFailure::kLargeResidual;
  return best;
}

}  // namespace dsorb::track
