// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/odometry/odometry.h"

#include "base/describe.h"
#include "base/parallel.h"
#include "odometry/frame_check.h"
#include "odometry/initial_map.h"
#include "track/motion_guesses.h"
#include "track/tracker.h"

#include <chrono>
#include <cmath>
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
      : camera_(camera),
        options_(checked(options)),
        arena_(options_.num_threads),
        initializer_(std::move(initializer)),
        tracker_(camera, options_.tracker),
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
    return phase_ == Phase::kInitializing ? initialize(frame) : track(frame);
  }

  void restart() {
    if (is_finished_) throw std::logic_error("Odometry::restart after finish()");
    retireKeyframes();
    if (phase_ != Phase::kInitializing) ++segment_;
    initializer_->reset();
    phase_ = Phase::kInitializing;
  }

  OdometryReport finish() {
    retireKeyframes();
    is_finished_ = true;
    return report_;
  }

 private:
  enum class Phase { kInitializing, kTracking, kLost };

  /// Phase initializing: feeds the initializer; its result starts tracking.
  FrameEstimate initialize(const FramePtr& frame) {
    FrameEstimate estimate;
    estimate.frame = frame;
    estimate.segment = segment_;
    InitStep step;
    {
      const StageTimer timer(report_.initializing_seconds);
      step = initializer_->addFrame(frame);
      if (step.result) seedTracking(*step.result, estimate);
    }
    tell([&](OdometryObserver& o) { o.onInitStep(step, *frame, segment_); });
    for (const KeyframeSnapshot& keyframe : keyframes_) {
      tell([&](OdometryObserver& o) { o.onKeyframe(keyframe); });
    }
    tell([&](OdometryObserver& o) { o.onFrame(estimate); });
    return estimate;
  }

  /// Takes over the initial map: seen from its newest frame, it is what frames are tracked against.
  /// Measured with true poses and depths, frames tracked until lost, against the newest frame or
  /// the initial reference: 9.6 or 2.2 in the mean on synthetic street (4 and 6 initial frames), 20
  /// or 17 on TartanAir hospital (8 initial frames).
  void seedTracking(const InitializationResult& result, FrameEstimate& estimate) {
    checkInvariants(result);
    const PosedFrame& newest = result.frames.back();
    tracker_.setReference(newest.frame,
                          odometry::depthSamples(result, camera_, result.frames.size() - 1),
                          newest.affine);
    T_world_reference_ = newest.T_cam_ref->inverse();
    history_ = {};
    for (const PosedFrame& posed : result.frames) {
      // Motion over a gap would pass for a faster one: the history starts anew behind it.
      if (posed.T_cam_ref) {
        history_.push(*posed.T_cam_ref * T_world_reference_);
      } else {
        history_ = {};
      }
    }
    affine_ = newest.affine;
    rmse_ = track::TrackingStart{}.previous_rmse;
    keyframes_ = odometry::initialKeyframes(result, camera_, segment_);
    report_.keyframes += static_cast<int>(keyframes_.size());
    ++report_.segments;
    phase_ = Phase::kTracking;

    estimate.state = OdometryState::kInitialized;
    estimate.is_keyframe = true;
    estimate.T_world_cam = T_world_reference_;
    estimate.keyframe = newest.frame->id();
    estimate.T_cam_keyframe = SE3();
    estimate.affine = newest.affine;
  }

  /// Phase tracking: pose of one frame against the initial map, or the loss of it.
  FrameEstimate track(const FramePtr& frame) {
    track::TrackingResult result;
    {
      const StageTimer timer(report_.tracking_seconds);
      const track::TrackingStart start{
          track::motionGuesses(history_), affine_, rmse_, options_.tracker.max_gain_step};
      result = arena_.run([&] { return tracker_.track(*frame, start); });
    }
    FrameEstimate estimate;
    estimate.frame = frame;
    estimate.segment = segment_;
    if (std::isfinite(result.rmse[0])) estimate.tracking_rmse = result.rmse[0];
    if (!result.good()) return lose(std::move(estimate));
    history_.push(result.T_frame_reference);
    affine_ = result.affine;
    rmse_ = result.rmse[0];
    ++report_.frames_tracked;
    estimate.state = OdometryState::kTracked;
    estimate.T_world_cam = T_world_reference_ * result.T_frame_reference.inverse();
    estimate.keyframe = tracker_.reference().frame().id();
    estimate.T_cam_keyframe = result.T_frame_reference;
    estimate.affine = result.affine;
    tell([&](OdometryObserver& o) { o.onFrame(estimate); });
    return estimate;
  }

  /// Into phase lost, which only restart() leaves.
  FrameEstimate lose(FrameEstimate estimate) {
    estimate.state = OdometryState::kLost;
    lost_at_ = estimate.frame->id();
    phase_ = Phase::kLost;
    tell([&](OdometryObserver& o) { o.onFrame(estimate); });
    retireKeyframes();
    tell([&](OdometryObserver& o) { o.onLost(lost_at_, segment_); });
    return estimate;
  }

  void retireKeyframes() {
    const std::vector<KeyframeSnapshot> retired = std::exchange(keyframes_, {});
    for (const KeyframeSnapshot& keyframe : retired) {
      tell([&](OdometryObserver& o) { o.onKeyframeRetired(keyframe); });
    }
  }

  template <typename Function>
  void tell(const Function& call) {
    for (OdometryObserver* observer : observers_) call(*observer);
  }

  PinholeCamera camera_;
  OdometryOptions options_;
  TaskArena arena_;
  std::unique_ptr<Initializer> initializer_;
  track::Tracker tracker_;
  odometry::FrameCheck frame_check_;
  std::vector<OdometryObserver*> observers_;

  Phase phase_ = Phase::kInitializing;
  bool is_finished_ = false;
  int segment_ = 0;
  FrameId lost_at_;
  OdometryReport report_;

  // Phase tracking: what the next frame is tracked with.
  SE3 T_world_reference_;
  track::MotionHistory history_;
  AffineBrightness affine_;                  // of the previous frame
  double rmse_ = 0;                          // of the previous frame, level 0 [grey levels]
  std::vector<KeyframeSnapshot> keyframes_;  // not yet retired
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
