// SPDX-License-Identifier: BSD-3-Clause
#include "track/tracker.h"

#include "estimate/sampling.h"
#include "estimate/warp.h"
#include "image/contrast.h"
#include "track/pose_alignment.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdlib>
#include <limits>
#include <stdexcept>
#include <utility>

namespace dsorb::track {
namespace {

constexpr double kSmallRotation = 0.02;  // vector part of a quaternion before it is normalised
constexpr double kRepeatedShare = 0.05;  // of a step; less is another image of the same moment
constexpr double kRepeatedFor = 2.5;     // intervals
constexpr double kMaxIntervals = 4;      // over which a velocity is extrapolated

/// Appends base * rotation for the rotations about exactly `axes` axes, all signs.
void appendSmallRotations(const SE3& base, int axes, std::vector<SE3>& guesses) {
  for (int x = -1; x <= 1; ++x) {
    for (int y = -1; y <= 1; ++y) {
      for (int z = -1; z <= 1; ++z) {
        if (std::abs(x) + std::abs(y) + std::abs(z) != axes) continue;
        const Eigen::Quaterniond rotation(
            1.0, x * kSmallRotation, y * kSmallRotation, z * kSmallRotation);
        guesses.push_back(base * SE3(rotation, Eigen::Vector3d::Zero()));
      }
    }
  }
}

/// Time since the previous frame over the interval before; 1 where times do not grow. Motion is not
/// constant for long.
double intervals(const TimedPose& previous, const TimedPose& before, double time) {
  const double ratio = (time - previous.time) / (previous.time - before.time);
  return std::isfinite(ratio) && ratio > 0 ? std::min(ratio, kMaxIntervals) : 1;
}

Vector6d stepBetween(const TimedPose& older, const TimedPose& newer) {
  return (newer.T_cam_world * older.T_cam_world.inverse()).log();
}

/// Whether a frame shows hardly anything of the motion that was expected; not for long, as then the
/// camera stands still.
bool repeats(const TimedPose& newest, const TimedPose& previous, const TimedPose& before) {
  const double waited = intervals(previous, before, newest.time);
  const double expected = waited * stepBetween(before, previous).norm();
  return waited < kRepeatedFor && stepBetween(previous, newest).norm() < kRepeatedShare * expected;
}

constexpr std::size_t kPoints = 600;    // looked at
constexpr std::size_t kMinPoints = 20;  // that are not clipped
constexpr double kTail = 0.05;          // of the points at either end, left out

// An image is clipped at its largest or smallest grey level if many points have it.
constexpr double kManyPoints = 0.02;  // of all
constexpr float kSameGrey = 2;        // so near to the extreme counts as it [grey levels]
/// Share of the range of grey levels in which, near the extreme, edges are partly clipped.
constexpr float kClippedMargin = 0.15F;

/// Grey levels between which an image is not clipped.
struct GreyRange {
  float darkest = -std::numeric_limits<float>::infinity();
  float brightest = std::numeric_limits<float>::infinity();

  [[nodiscard]] bool contains(float grey) const { return grey > darkest && grey < brightest; }
};

GreyRange unclippedRange(const std::vector<float>& sorted) {
  GreyRange range;
  const auto many = static_cast<std::size_t>(kManyPoints * static_cast<double>(sorted.size()));
  const float lowest = sorted.front();
  const float highest = sorted.back();
  const float margin = kClippedMargin * (highest - lowest);
  if (sorted[many] <= lowest + kSameGrey) range.darkest = lowest + margin;
  if (sorted[sorted.size() - 1 - many] >= highest - kSameGrey) range.brightest = highest - margin;
  return range;
}

/// The ranks that count.
std::pair<std::size_t, std::size_t> withoutTails(std::size_t count) {
  const auto tail = static_cast<std::size_t>(kTail * static_cast<double>(count));
  return {tail, count - tail};
}

constexpr std::size_t kFlowStride = 32;  // [points]
constexpr double kFlowMinDepth = 0.01;  // of the depth in the reference; nearer points have no flow
constexpr double kFlowPrior = 0.1;      // added to the number of flow samples

/// Adds the squared image displacement of a pixel that moves to the ray q.
/// @return false where the ray passes the camera plane
bool addDisplacement(const PinholeCamera& camera,
                     const Eigen::Vector2d& pixel,
                     const Eigen::Vector3d& q,
                     double& sum) {
  if (!(q.z() > kFlowMinDepth)) return false;
  const double diagonal2 = static_cast<double>(camera.width) * camera.width +
                           static_cast<double>(camera.height) * camera.height;
  sum += std::min((camera.project(q) - pixel).squaredNorm(), diagonal2);
  return true;
}

// Front end of DSO as published.
constexpr std::array<int, kTrackingLevels> kMaxIterations = {10, 20, 50, 50, 50};
constexpr double kAbortFactor = 1.5;   // a hypothesis ends at a level worse than this x the best
constexpr double kAcceptFactor = 1.5;  // the search ends below this x the previous frame's rmse

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

void MotionHistory::push(const TimedPose& newest) {
  if (previous && before && repeats(newest, *previous, *before)) return;
  before = previous;
  previous = newest;
}

MotionHistory MotionHistory::relativeTo(const SE3& T_new_old) const {
  const SE3 T_old_new = T_new_old.inverse();
  MotionHistory moved = *this;
  for (std::optional<TimedPose>* timed : {&moved.previous, &moved.before}) {
    if (*timed) (*timed)->T_cam_world = (*timed)->T_cam_world * T_old_new;
  }
  return moved;
}

std::vector<SE3> motionGuesses(const MotionHistory& history, double time) {
  if (!history.previous) return {SE3()};
  const SE3& previous = history.previous->T_cam_world;
  constexpr std::size_t kAll = 31;
  std::vector<SE3> guesses;
  guesses.reserve(kAll);
  SE3 constant_motion = previous;
  if (history.before) {
    const Vector6d step = intervals(*history.previous, *history.before, time) *
                          stepBetween(*history.before, *history.previous);
    constant_motion = SE3::exp(step) * previous;
    guesses.push_back(constant_motion);
    guesses.push_back(SE3::exp(2 * step) * previous);
    guesses.push_back(SE3::exp(0.5 * step) * previous);
  }
  guesses.push_back(previous);
  guesses.emplace_back();
  for (int axes = 1; axes <= 3; ++axes) appendSmallRotations(constant_motion, axes, guesses);
  return guesses;
}

GreyComparison::GreyComparison(const TrackingReference& reference,
                               const Frame& frame,
                               const SE3& T_cur_ref) {
  const ReferencePoints& points = reference.at(0);
  const PyramidLevel& level = frame.level(0);
  const auto warp = makeWarp<float>(reference.camera, T_cur_ref);
  const std::size_t stride = std::max<std::size_t>(points.size() / kPoints, 1);
  for (std::size_t i = 0; i < points.size(); i += stride) {
    const WarpedPoint<float> p =
        warpPoint(warp, points.ray_x[i], points.ray_y[i], points.inverse_depth[i]);
    if (!p.front || !canSample(level, p.x, p.y)) continue;
    const float intensity = interpolateIntensity(level, p.x, p.y);
    if (!std::isfinite(intensity)) continue;
    reference_.push_back(points.intensity[i]);
    frame_.push_back(intensity);
  }
  std::sort(reference_.begin(), reference_.end());
  std::sort(frame_.begin(), frame_.end());
  if (!frame_.empty() && std::isfinite(unclippedRange(frame_).brightest)) ceiling_ = frame_.back();
}

std::optional<BrightnessTransfer> GreyComparison::transfer() const {
  if (frame_.size() < kMinPoints) return std::nullopt;
  const GreyRange reference_range = unclippedRange(reference_);
  const GreyRange frame_range = unclippedRange(frame_);
  const auto [begin, end] = withoutTails(frame_.size());
  GreyLine line;
  for (std::size_t i = begin; i < end; ++i) {
    if (!reference_range.contains(reference_[i]) || !frame_range.contains(frame_[i])) continue;
    line.add(static_cast<double>(reference_[i]), static_cast<double>(frame_[i]));
  }
  if (line.weight() < static_cast<double>(kMinPoints)) return std::nullopt;
  const std::optional<BrightnessTransfer> fitted = line.transfer();
  return fitted && fitted->gain > 0 ? fitted : std::nullopt;
}

double GreyComparison::misfit(const BrightnessTransfer& transfer) const {
  const auto [begin, end] = withoutTails(frame_.size());
  const auto n = static_cast<double>(end - begin);
  double errors = 0;
  double sum = 0;
  double squares = 0;
  for (std::size_t i = begin; i < end; ++i) {
    const auto grey = static_cast<double>(frame_[i]);
    const double predicted = transfer.gain * static_cast<double>(reference_[i]) + transfer.offset;
    const double error = grey - std::min(predicted, static_cast<double>(ceiling_));
    errors += error * error;
    sum += grey;
    squares += grey * grey;
  }
  const double variance = squares / n - sum / n * (sum / n);
  return variance > 0 ? std::sqrt(errors / n / variance) : std::numeric_limits<double>::infinity();
}

FlowIndicators flowIndicators(const ReferencePoints& points,
                              const PinholeCamera& camera,
                              const SE3& T_cur_ref) {
  const Eigen::Matrix3d R = T_cur_ref.rotationMatrix();
  double translation_sum = 0;
  double full_sum = 0;
  int translation_count = 0;
  int full_count = 0;
  for (std::size_t i = 0; i < points.size(); i += kFlowStride) {
    const Eigen::Vector3d ray(points.ray_x[i], points.ray_y[i], 1.0);
    const Eigen::Vector2d pixel = camera.project(ray);
    const Eigen::Vector3d shift =
        static_cast<double>(points.inverse_depth[i]) * T_cur_ref.translation();
    for (const double sign : {1.0, -1.0}) {
      translation_count += addDisplacement(camera, pixel, ray + sign * shift, translation_sum);
      full_count += addDisplacement(camera, pixel, R * ray + sign * shift, full_sum);
    }
  }
  return {translation_sum / (translation_count + kFlowPrior), full_sum / (full_count + kFlowPrior)};
}

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
  }
  const bool inside = descent.inside_fraction >= options_.min_inside_fraction;
  descent.failure = inside ? TrackingFailure::kNone : TrackingFailure::kTooFewInside;
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
