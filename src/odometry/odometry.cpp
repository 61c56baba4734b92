// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/odometry/odometry.h"

#include "base/describe.h"
#include "base/parallel.h"
#include "image/frame_check.h"
#include "odometry/mapper.h"
#include "odometry/probation.h"
#include "track/motion_guesses.h"
#include "track/tracker.h"
#include "window/keyframe_policy.h"

#include <chrono>
#include <cmath>
#include <deque>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

namespace dsorb {
namespace {

/// Adds the time of its own life to a counter [s]. Times are reported, never decided upon.
class StageTimer {
 public:
  explicit StageTimer(double& seconds) : seconds_(seconds) {}
  ~StageTimer() {
    seconds_ += std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
  }
  StageTimer(const StageTimer&) = delete;
  StageTimer& operator=(const StageTimer&) = delete;

 private:
  double& seconds_;
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

OdometryOptions checked(OdometryOptions options) {
  options.initializer.num_threads = options.num_threads;
  validateOptions(options);
  return options;
}

}  // namespace

class Odometry::Impl {
 public:
  Impl(const PinholeCamera& camera,
       const OdometryOptions& options,
       std::unique_ptr<Initializer> initializer)
      : options_(checked(options)),
        arena_(options_.num_threads),
        initializer_(std::move(initializer)),
        tracker_(camera, options_.tracker),
        mapper_(camera, options_),
        probation_(options_.probation),
        frame_check_(camera) {
    if (initializer_ == nullptr) initializer_ = makeInitializer(options_.initializer, camera);
  }

  void addObserver(OdometryObserver* observer) {
    if (observer == nullptr) throw std::invalid_argument("observer is null");
    observers_.push_back(observer);
  }

  FrameEstimate process(const FramePtr& frame) {
    if (is_finished_) throw std::logic_error("Odometry::process after finish()");
    if (phase_ == Phase::kLost) {
      throw std::logic_error("Odometry::process after the loss at frame " +
                             std::to_string(lost_at_.value) + " without restart()");
    }
    frame_check_.accept(frame);
    ++report_.frames_given;
    waiting_.push_back(frame);
    FrameEstimate estimate;
    while (!waiting_.empty() && phase_ != Phase::kLost) {
      const FramePtr next = waiting_.front();
      waiting_.pop_front();
      estimate = phase_ == Phase::kInitializing ? initialize(next) : track(next);
    }
    return estimate;
  }

  void restart() {
    if (is_finished_) throw std::logic_error("Odometry::restart after finish()");
    retireAll();
    if (phase_ != Phase::kInitializing) ++segment_;
    initializer_->reset();
    phase_ = Phase::kInitializing;
  }

  OdometryReport finish() {
    retireAll();
    is_finished_ = true;
    return report_;
  }

 private:
  enum class Phase { kInitializing, kTracking, kLost };

  /// Phase initializing: feeds the initializer; its result becomes the first window.
  FrameEstimate initialize(const FramePtr& frame) {
    FrameEstimate estimate = blank(frame);
    InitStep step;
    {
      const StageTimer timer(report_.initializing_seconds);
      step = initializer_->addFrame(frame);
    }
    if (step.result) checkInvariants(*step.result);
    tell([&](OdometryObserver& o) { o.onInitStep(step, *frame, segment_); });
    if (step.result) return takeOver(*step.result, std::move(estimate));
    // Frames that are used again were told when they came.
    if (waiting_.empty()) tell([&](OdometryObserver& o) { o.onFrame(estimate); });
    return estimate;
  }

  /// The first window, and tracking with it.
  FrameEstimate takeOver(const InitializationResult& result, FrameEstimate estimate) {
    odometry::MappingReport mapping;
    {
      const StageTimer timer(report_.mapping_seconds);
      mapping = arena_.run([&] { return mapper_.seed(result); });
    }
    phase_ = Phase::kTracking;
    ++report_.segments;
    tracked_before_ = report_.frames_tracked;
    probation_.begin(result);
    history_ = {};
    const SE3 T_ref_newest = result.frames.back().T_cam_ref->inverse();
    for (const PosedFrame& posed : result.frames) {
      // Motion over a gap would pass for a faster one: the history starts anew behind it.
      if (posed.T_cam_ref) {
        history_.push(*posed.T_cam_ref * T_ref_newest);
      } else {
        history_ = {};
      }
    }
    rmse_ = track::TrackingStart{}.previous_rmse;
    report_.keyframes += mapping.keyframes_so_far;
    estimate.state = OdometryState::kInitialized;
    return closeKeyframe(mapping, std::move(estimate));
  }

  /// Phase tracking: pose of one frame; it refines the map or becomes a keyframe.
  FrameEstimate track(const FramePtr& frame) {
    track::TrackingResult result;
    {
      const StageTimer timer(report_.tracking_seconds);
      const track::TrackingStart start{
          track::motionGuesses(history_), affine_, rmse_, options_.tracker.max_gain_step};
      result = arena_.run([&] { return tracker_.track(*frame, start); });
    }
    FrameEstimate estimate = blank(frame);
    if (std::isfinite(result.rmse[0])) estimate.tracking_rmse = result.rmse[0];
    if (!result.good()) return lose(std::move(estimate));
    const bool is_keyframe = needsKeyframe(*frame, result);
    const window::Keyframe& reference = mapper_.newest();
    estimate.state = OdometryState::kTracked;
    estimate.T_world_cam = (result.T_frame_reference * reference.T_cam_world()).inverse();
    estimate.keyframe = reference.frame->id();
    estimate.T_cam_keyframe = result.T_frame_reference;
    estimate.affine = affine_ = result.affine;
    history_.push(result.T_frame_reference);
    rmse_ = result.rmse[0];
    if (probation_.active()) probation_.add(frame);
    return map(std::move(estimate), is_keyframe);
  }

  [[nodiscard]] bool needsKeyframe(const Frame& frame, const track::TrackingResult& result) {
    const window::Keyframe& reference = mapper_.newest();
    if (!first_rmse_) first_rmse_ = result.rmse[0];
    window::KeyframeEvidence evidence;
    evidence.translation_flow = result.flow.translation;
    evidence.full_flow = result.flow.full;
    evidence.log_gain = std::log(
        brightnessTransfer(
            reference.affine(), reference.frame->exposure(), result.affine, frame.exposure())
            .gain);
    evidence.rmse = result.rmse[0];
    evidence.first_rmse = *first_rmse_;
    evidence.seconds_since_keyframe = std::abs(frame.timestamp() - reference.frame->timestamp());
    evidence.width_plus_height = frame.width() + frame.height();
    return window::needsKeyframe(evidence, options_.window.policy);
  }

  /// Uses a tracked frame in the map.
  FrameEstimate map(FrameEstimate estimate, bool is_keyframe) {
    odometry::MappingReport mapping;
    {
      const StageTimer timer(report_.mapping_seconds);
      const window::TrackedFrame tracked{
          estimate.frame, estimate.T_world_cam->inverse(), estimate.affine};
      arena_.run([&] {
        mapper_.refine(tracked);
        if (is_keyframe) mapping = mapper_.addKeyframe(tracked);
      });
    }
    if (is_keyframe) {
      ++report_.keyframes;
      history_ = history_.relativeToPrevious();
      return closeKeyframe(mapping, std::move(estimate));
    }
    ++report_.frames_tracked;
    tell([&](OdometryObserver& o) { o.onFrame(estimate); });
    return estimate;
  }

  /// After an adjustment: the newest keyframe is what the next frames are tracked against.
  FrameEstimate closeKeyframe(const odometry::MappingReport& mapping, FrameEstimate estimate) {
    if (!mapping.adjustment.finite) return lose(std::move(estimate));
    noise_ = mapping.adjustment.rms;
    if (probation_.active() && !probation_.passes(mapping.keyframes_so_far, noise_)) {
      return withdraw(std::move(estimate));
    }
    const window::Keyframe& newest = mapper_.newest();
    tracker_.setReference(newest.frame, mapping.reference, newest.affine());
    affine_ = newest.affine();
    first_rmse_.reset();
    estimate.is_keyframe = true;
    estimate.T_world_cam = newest.T_cam_world().inverse();
    estimate.keyframe = newest.frame->id();
    estimate.T_cam_keyframe = SE3();
    estimate.affine = affine_;
    if (estimate.state == OdometryState::kTracked) ++report_.frames_tracked;
    retire(mapping.retired, mapper_.camera());
    for (const window::Keyframe& keyframe : mapper_.keyframes()) {
      const KeyframeSnapshot shot =
          odometry::snapshot(keyframe, mapper_.camera(), segment_, noise_);
      tell([&](OdometryObserver& o) { o.onKeyframe(shot); });
    }
    tell([&](OdometryObserver& o) { o.onFrame(estimate); });
    return estimate;
  }

  /// The map has failed its probation: its frames but the reference are used again. Observers learn
  /// it by the initializer being asked anew in the same segment.
  FrameEstimate withdraw(FrameEstimate estimate) {
    report_.keyframes -= static_cast<int>(mapper_.clear().size());
    report_.frames_tracked = tracked_before_;
    --report_.segments;
    std::deque<FramePtr> again = probation_.end();
    again.insert(again.end(), waiting_.begin(), waiting_.end());
    waiting_ = std::move(again);
    initializer_->reset();
    phase_ = Phase::kInitializing;
    return estimate;
  }

  /// Into phase lost, which only restart() leaves.
  FrameEstimate lose(FrameEstimate estimate) {
    const std::optional<double> rmse = estimate.tracking_rmse;
    estimate = blank(waiting_.empty() ? estimate.frame : waiting_.back());
    waiting_.clear();
    estimate.tracking_rmse = rmse;
    estimate.state = OdometryState::kLost;
    lost_at_ = estimate.frame->id();
    phase_ = Phase::kLost;
    tell([&](OdometryObserver& o) { o.onFrame(estimate); });
    retireAll();
    tell([&](OdometryObserver& o) { o.onLost(lost_at_, segment_); });
    return estimate;
  }

  [[nodiscard]] FrameEstimate blank(const FramePtr& frame) const {
    FrameEstimate estimate;
    estimate.frame = frame;
    estimate.segment = segment_;
    return estimate;
  }

  void retire(const std::vector<window::Keyframe>& keyframes, const PinholeCamera& camera) {
    for (const window::Keyframe& keyframe : keyframes) {
      const KeyframeSnapshot shot = odometry::snapshot(keyframe, camera, segment_, noise_);
      tell([&](OdometryObserver& o) { o.onKeyframeRetired(shot); });
    }
  }

  void retireAll() {
    probation_.end();
    if (mapper_.empty()) return;
    const PinholeCamera camera = mapper_.camera();
    retire(mapper_.clear(), camera);
  }

  template <typename Function>
  void tell(const Function& call) {
    for (OdometryObserver* observer : observers_) call(*observer);
  }

  OdometryOptions options_;
  TaskArena arena_;
  std::unique_ptr<Initializer> initializer_;
  track::Tracker tracker_;
  odometry::Mapper mapper_;
  odometry::Probation probation_;
  FrameCheck frame_check_;
  std::vector<OdometryObserver*> observers_;

  Phase phase_ = Phase::kInitializing;
  bool is_finished_ = false;
  int segment_ = 0;
  FrameId lost_at_;
  OdometryReport report_;
  int tracked_before_ = 0;        // frames, the newest initialization
  std::deque<FramePtr> waiting_;  // to be processed: the frame given, behind those used again

  // Phase tracking: what the next frame is tracked with.
  track::MotionHistory history_;
  AffineBrightness affine_;           // of the previous frame
  double rmse_ = 0;                   // of the previous frame, level 0 [grey levels]
  std::optional<double> first_rmse_;  // of the first frame tracked against the newest keyframe
  double noise_ = 0;                  // rms residual of the last adjustment [grey levels]
};

Odometry::Odometry(const PinholeCamera& camera, const OdometryOptions& options)
    : impl_(std::make_unique<Impl>(camera, options, nullptr)) {}

Odometry::Odometry(const PinholeCamera& camera,
                   const OdometryOptions& options,
                   std::unique_ptr<Initializer> initializer) {
  if (initializer == nullptr) throw std::invalid_argument("initializer is null");
  impl_ = std::make_unique<Impl>(camera, options, std::move(initializer));
}

Odometry::~Odometry() = default;
Odometry::Odometry(Odometry&&) noexcept = default;
Odometry& Odometry::operator=(Odometry&&) noexcept = default;

void Odometry::addObserver(OdometryObserver* observer) {
  impl_->addObserver(observer);
}

FrameEstimate Odometry::process(const FramePtr& frame) {
  return impl_->process(frame);
}

void Odometry::restart() {
  impl_->restart();
}

OdometryReport Odometry::finish() {
  return impl_->finish();
}

}  // namespace dsorb
