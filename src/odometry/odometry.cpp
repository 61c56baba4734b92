// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/odometry/odometry.h"

#include "base/describe.h"
#include "base/parallel.h"
#include "base/timed.h"
#include "image/frame_check.h"
#include "odometry/async_mapper.h"
#include "odometry/frame_tracker.h"
#include "odometry/observers.h"
#include "odometry/segments.h"

#include <deque>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

namespace dsorb {
namespace {

OdometryOptions checked(OdometryOptions options) {
  options.initializer.num_threads = options.num_threads;
  validateOptions(options);
  return options;
}

/// What an own initializer may get wrong. @throws std::logic_error
void checkStep(const InitStep& step) {
  if ((step.status == InitStatus::kInitialized) != step.result.has_value()) {
    throw std::logic_error(std::string("initializer: a result is set exactly with kInitialized; ") +
                           (step.result ? "it came with another status" : "it is missing"));
  }
  if (step.result) checkInvariants(*step.result);
}

FrameEstimate estimateOf(const FramePtr& frame, int segment) {
  FrameEstimate estimate;
  estimate.frame = frame;
  estimate.segment = segment;
  return estimate;
}

/// Why the map cannot go on.
struct Failure {
  RollbackReason reason = RollbackReason::kLost;
  std::optional<double> tracking_rmse;
};

}  // namespace

/// The phases of a run. Frames wait in a queue: the one given, behind those that a start which was
/// rolled back leaves to be used again.
class Odometry::Impl {
 public:
  Impl(const PinholeCamera& camera,
       const OdometryOptions& options,
       std::unique_ptr<Initializer> initializer)
      : options_(checked(options)),
        arena_(options_.num_threads),
        initializer_(std::move(initializer)),
        tracker_(camera, options_),
        mapper_(camera, options_, arena_),
        segments_(options_.probation),
        frame_check_(camera) {
    if (initializer_ == nullptr) initializer_ = makeInitializer(options_.initializer, camera);
  }

  void addObserver(OdometryObserver* observer) { observers_.add(observer); }

  FrameEstimate process(const FramePtr& frame) {
    accept(frame);
    processPending();
    return last_estimate_;
  }

  void restart() {
    if (is_finished_) throw std::logic_error("Odometry::restart after finish()");
    finishMapping();
    pending_.clear();
    const bool was_placed = phase_ != Phase::kInitializing;
    retireAll();
    if (was_placed) segments_.next();
    initializer_->reset();
    phase_ = Phase::kInitializing;
  }

  OdometryReport finish() {
    if (is_finished_) return report();
    is_finished_ = true;
    do {  // The last keyframes may roll the start back: its frames are used again.
      processPending();
      finishMapping();
    } while (!pending_.empty());
    retireAll();
    return report();
  }

 private:
  enum class Phase { kInitializing, kTracking, kLost };

  void accept(const FramePtr& frame) {
    if (is_finished_) throw std::logic_error("Odometry::process after finish()");
    if (phase_ == Phase::kLost) {
      throw std::logic_error("Odometry::process after the loss at frame " +
                             std::to_string(last_input_->id().value) + " without restart()");
    }
    frame_check_.accept(frame);
    ++report_.frames_given;
    last_input_ = frame;
    pending_.push_back(frame);
  }

  void processPending() {
    while (!pending_.empty()) {
      std::optional<Failure> failure = adoptKeyframes();
      if (!failure) failure = phase_ == Phase::kInitializing ? initialize() : track();
      if (failure) giveUp(*failure);
    }
  }

  /// Phase initializing: feeds the initializer; its result becomes the first map.
  std::optional<Failure> initialize() {
    const FramePtr frame = nextPending();
    const InitStep step =
        timed(report_.initializing_seconds, [&] { return initializer_->addFrame(frame); });
    checkStep(step);
    observers_.notify(&OdometryObserver::onInitStep, step, *frame, segments_.current());
    last_estimate_ = estimateOf(frame, segments_.current());
    if (step.result) return begin(*step.result);
    // Frames that are used again were told when they came.
    if (pending_.empty()) observers_.notify(&OdometryObserver::onFrame, last_estimate_);
    return std::nullopt;
  }

  /// Phase tracking begins with the map of an initialization.
  std::optional<Failure> begin(const InitializationResult& result) {
    phase_ = Phase::kTracking;
    segments_.begin(result);
    tracker_.begin(result);
    const std::optional<Failure> failure = adopt(mapper_.seed(result, segments_.current()));
    if (failure) return failure;
    FrameEstimate estimate = last_estimate_;
    estimate.state = OdometryState::kInitialized;
    estimate.is_keyframe = true;
    conclude(std::move(estimate));
    return std::nullopt;
  }

  /// Phase tracking: pose of one frame, which then goes into the map.
  std::optional<Failure> track() {
    odometry::TrackedPose pose = poseOf(*pending_.front());
    if (!pose.good && mapper_.busy()) {  // once more, against a newer keyframe
      mapper_.wait();
      if (const std::optional<Failure> failure = adoptKeyframes()) return failure;
      pose = poseOf(*pending_.front());
    }
    if (!pose.good) return Failure{RollbackReason::kLost, pose.rmse};
    FrameEstimate estimate = estimateOf(nextPending(), segments_.current());
    estimate.state = OdometryState::kTracked;
    estimate.is_keyframe = pose.wants_keyframe && !mapper_.keyframeIsDue();
    estimate.T_world_cam = pose.T_cam_world.inverse();
    estimate.keyframe = pose.keyframe;
    estimate.T_cam_keyframe = pose.T_cam_keyframe;
    estimate.affine = pose.affine;
    estimate.tracking_rmse = pose.rmse;
    segments_.keepForRollback(estimate.frame);
    mapper_.submit({estimate.frame, std::move(pose), estimate.is_keyframe});
    if (const std::optional<Failure> failure = adoptKeyframes()) return failure;
    segments_.countTrackedFrame();
    conclude(std::move(estimate));
    return std::nullopt;
  }

  [[nodiscard]] odometry::TrackedPose poseOf(const Frame& frame) {
    return timed(report_.tracking_seconds,
                 [&] { return arena_.run([&] { return tracker_.track(frame); }); });
  }

  /// Tells of a frame. Where mapping has made a keyframe of it, its pose is that after adjustment.
  void conclude(FrameEstimate estimate) {
    const odometry::KeyframePose& newest = tracker_.target();
    if (estimate.frame == newest.frame) {
      estimate.T_world_cam = newest.T_cam_world.inverse();
      estimate.affine = newest.affine;
      if (!estimate.keyframe) {  // of an initialization
        estimate.keyframe = estimate.frame->id();
        estimate.T_cam_keyframe = SE3();
      }
    }
    last_estimate_ = std::move(estimate);
    observers_.notify(&OdometryObserver::onFrame, last_estimate_);
  }

  /// Adopts all keyframes that mapping has finished.
  std::optional<Failure> adoptKeyframes() {
    while (const std::optional<odometry::MappingResult> result = takeResult()) {
      if (const std::optional<Failure> failure = adopt(*result)) return failure;
    }
    return std::nullopt;
  }

  /// @throws what mapping threw; the map is lost then
  std::optional<odometry::MappingResult> takeResult() {
    try {
      return mapper_.take();
    } catch (...) {
      phase_ = Phase::kLost;
      pending_.clear();
      throw;
    }
  }

  /// Later frames are tracked against the newest keyframe, unless its adjustment failed.
  std::optional<Failure> adopt(const odometry::MappingResult& result) {
    report_.mapping_seconds += result.seconds;
    if (!result.update) return std::nullopt;
    const odometry::MapUpdate& update = *result.update;
    segments_.countKeyframes(update.new_keyframes);
    if (!update.finite) return Failure{};
    if (!segments_.passes(update.rms)) return Failure{RollbackReason::kResidual, {}};
    arena_.run([&] { tracker_.setTarget(update.target); });
    observers_.notifyEach(&OdometryObserver::onKeyframeRetired, update.retired);
    observers_.notifyEach(&OdometryObserver::onKeyframe, update.window);
    return std::nullopt;
  }

  void finishMapping() {
    mapper_.wait();
    if (const std::optional<Failure> failure = adoptKeyframes()) giveUp(*failure);
  }

  void giveUp(const Failure& failure) {
    if (segments_.canRollBack(failure.reason)) {
      rollBack(failure.reason);
    } else {
      lose(failure.tracking_rmse);
    }
  }

  /// Back to phase initializing, with the frames since the reference.
  void rollBack(RollbackReason reason) {
    odometry::FailedStart start = segments_.rollBack(reason, last_input_->id());
    mapper_.clear();
    pending_.insert(pending_.begin(), start.frames.begin(), start.frames.end());
    initializer_->reset();
    phase_ = Phase::kInitializing;
    observers_.notify(&OdometryObserver::onInitializationRollback, start.notice);
  }

  /// Into phase lost, which only restart() leaves.
  void lose(std::optional<double> tracking_rmse) {
    pending_.clear();
    phase_ = Phase::kLost;
    last_estimate_ = estimateOf(last_input_, segments_.current());
    last_estimate_.state = OdometryState::kLost;
    last_estimate_.tracking_rmse = tracking_rmse;
    observers_.notify(&OdometryObserver::onFrame, last_estimate_);
    retireAll();
    observers_.notify(&OdometryObserver::onLost, last_input_->id(), segments_.current());
  }

  void retireAll() {
    segments_.endProbation();
    observers_.notifyEach(&OdometryObserver::onKeyframeRetired, mapper_.clear());
  }

  [[nodiscard]] OdometryReport report() const {
    OdometryReport report = report_;
    report.segments = segments_.counts().starts;
    report.keyframes = segments_.counts().keyframes;
    report.frames_tracked = segments_.counts().tracked_frames;
    return report;
  }

  [[nodiscard]] FramePtr nextPending() {
    FramePtr frame = std::move(pending_.front());
    pending_.pop_front();
    return frame;
  }

  OdometryOptions options_;
  TaskArena arena_;
  std::unique_ptr<Initializer> initializer_;
  odometry::FrameTracker tracker_;
  odometry::AsyncMapper mapper_;
  odometry::Segments segments_;
  odometry::Observers observers_;
  FrameCheck frame_check_;

  Phase phase_ = Phase::kInitializing;
  bool is_finished_ = false;
  OdometryReport report_;         // without what segments_ counts
  std::deque<FramePtr> pending_;  // oldest first
  FramePtr last_input_;
  FrameEstimate last_estimate_;
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
