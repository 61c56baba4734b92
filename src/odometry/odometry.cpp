// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/odometry/odometry.h"

#include "base/describe.h"
#include "base/parallel.h"
#include "base/worker_queue.h"
#include "image/frame_check.h"
#include "odometry/frame_tracker.h"
#include "odometry/mapper.h"
#include "odometry/probation.h"

#include <chrono>
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

/// What an own initializer may get wrong. @throws std::logic_error
void checkStep(const InitStep& step) {
  if ((step.status == InitStatus::kInitialized) != step.result.has_value()) {
    throw std::logic_error(std::string("initializer: a result is set exactly with kInitialized; ") +
                           (step.result ? "it came with another status" : "it is missing"));
  }
  if (step.result) checkInvariants(*step.result);
}

}  // namespace

class Odometry::Impl {
 public:
  Impl(const PinholeCamera& camera,
       const OdometryOptions& options,
       std::unique_ptr<Initializer> initializer)
      : options_(checked(options)),
        arena_(options_.num_threads),
        mapping_arena_(options_.num_threads),
        initializer_(std::move(initializer)),
        tracker_(camera, options_),
        mapper_(camera, options_),
        probation_(options_.probation),
        frame_check_(camera),
        mapping_([this](const odometry::MappingJob& job) { return map(job); },
                 options_.pipelined ? options_.max_waiting : 0) {
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
    last_input_ = frame;
    waiting_.push_back(frame);
    processPending();
    return last_estimate_;
  }

  void restart() {
    if (is_finished_) throw std::logic_error("Odometry::restart after finish()");
    mapping_.wait();
    receive(nullptr);
    waiting_.clear();
    const bool was_placed = phase_ != Phase::kInitializing;
    retireAll();
    if (was_placed) {
      ++segment_;
      was_lost_in_probation_ = false;
    }
    initializer_->reset();
    phase_ = Phase::kInitializing;
  }

  OdometryReport finish() {
    if (is_finished_) return report_;
    is_finished_ = true;
    do {  // the last keyframes may take the start back: its frames are used again
      processPending();
      mapping_.wait();
      receive(nullptr);
    } while (!waiting_.empty());
    retireAll();
    return report_;
  }

 private:
  enum class Phase { kInitializing, kTracking, kLost };

  /// Works on all frames that wait.
  void processPending() {
    while (!waiting_.empty()) {
      receive(nullptr);
      if (waiting_.empty()) return;
      phase_ == Phase::kInitializing ? initialize() : track();
    }
  }

  /// Phase initializing: feeds the initializer; its result becomes the first window.
  void initialize() {
    const FramePtr frame = nextWaiting();
    InitStep step;
    {
      const StageTimer timer(report_.initializing_seconds);
      step = initializer_->addFrame(frame);
    }
    checkStep(step);
    notify([&](OdometryObserver& o) { o.onInitStep(step, *frame, segment_); });
    last_estimate_ = blank(frame);
    if (step.result) return takeOver(*step.result);
    // Frames that are used again were told when they came.
    if (waiting_.empty()) notify([&](OdometryObserver& o) { o.onFrame(last_estimate_); });
  }

  /// The first window, and tracking with it.
  void takeOver(const InitializationResult& result) {
    phase_ = Phase::kTracking;
    before_ = report_;
    ++report_.segments;
    probation_.begin(result);
    tracker_.begin(result);
    odometry::MapUpdate update;
    {
      const StageTimer timer(report_.mapping_seconds);
      update = arena_.run([&] { return mapper_.seed(result); });
    }
    report_.keyframes += update.keyframes_so_far;
    FrameEstimate estimate = last_estimate_;
    estimate.state = OdometryState::kInitialized;
    estimate.is_keyframe = true;
    if (adopt(update, &estimate)) close(std::move(estimate));
  }

  /// Phase tracking: pose of one frame, which then goes into the map.
  void track() {
    odometry::TrackedPose pose = poseOf(*waiting_.front());
    if (!pose.good && mapping_.busy()) {  // once more, against a newer keyframe
      mapping_.wait();
      receive(nullptr);
      if (phase_ != Phase::kTracking) return;
      pose = poseOf(*waiting_.front());
    }
    if (!pose.good) return lose(pose.rmse);
    FrameEstimate estimate = blank(nextWaiting());
    estimate.tracking_rmse = pose.rmse;
    estimate.state = OdometryState::kTracked;
    estimate.is_keyframe = pose.wants_keyframe && !keyframe_is_due_;
    estimate.T_world_cam = pose.T_cam_world.inverse();
    estimate.keyframe = pose.keyframe;
    estimate.T_cam_keyframe = pose.T_cam_keyframe;
    estimate.affine = pose.affine;
    if (probation_.active()) probation_.add(estimate.frame);
    keyframe_is_due_ |= estimate.is_keyframe;
    mapping_.submit({estimate.frame, std::move(pose), estimate.is_keyframe});
    if (!receive(&estimate)) return;
    ++report_.frames_tracked;
    close(std::move(estimate));
  }

  [[nodiscard]] odometry::TrackedPose poseOf(const Frame& frame) {
    const StageTimer timer(report_.tracking_seconds);
    return arena_.run([&] { return tracker_.track(frame); });
  }

  /// Work of the mapping queue; pipelined, it runs in the queue's thread.
  odometry::MappingResult map(const odometry::MappingJob& job) {
    odometry::MappingResult result;
    TaskArena& arena = options_.pipelined ? mapping_arena_ : arena_;
    {
      const StageTimer timer(result.seconds);
      result.update = arena.run([&] { return mapper_.map(job); });
    }
    return result;
  }

  /// Takes what mapping has finished.
  /// @param estimate of the frame given last, or null; becomes that of its keyframe
  /// @return whether the map is still there
  bool receive(FrameEstimate* estimate) {
    while (std::optional<odometry::MappingResult> result = takeResult()) {
      report_.mapping_seconds += result->seconds;
      if (!result->update) continue;
      ++report_.keyframes;
      keyframe_is_due_ = false;
      if (!adopt(*result->update, estimate)) return false;
    }
    return true;
  }

  /// @throws what mapping threw; the map is lost then
  std::optional<odometry::MappingResult> takeResult() {
    try {
      return mapping_.take();
    } catch (...) {
      phase_ = Phase::kLost;
      lost_at_ = last_input_->id();
      waiting_.clear();
      throw;
    }
  }

  /// After an adjustment: the newest keyframe is what the next frames are tracked against.
  bool adopt(odometry::MapUpdate& update, FrameEstimate* estimate) {
    if (!update.finite) {
      lose(std::nullopt);
      return false;
    }
    if (probation_.active() && !probation_.passes(update.rms)) {
      rollBack(RollbackReason::kResidual);
      return false;
    }
    const odometry::TrackingTarget& newest = update.target;
    arena_.run([&] { tracker_.setTarget(newest); });
    if (estimate != nullptr && estimate->frame == newest.frame) {
      estimate->T_world_cam = newest.T_cam_world.inverse();
      if (!estimate->keyframe) {  // not tracked
        estimate->keyframe = newest.frame->id();
        estimate->T_cam_keyframe = SE3();
      }
      estimate->affine = newest.affine;
    }
    notifyRetired(update.retired);
    for (KeyframeSnapshot& keyframe : update.window) {
      keyframe.segment = segment_;
      notify([&](OdometryObserver& o) { o.onKeyframe(keyframe); });
    }
    return true;
  }

  void close(FrameEstimate estimate) {
    last_estimate_ = std::move(estimate);
    notify([&](OdometryObserver& o) { o.onFrame(last_estimate_); });
  }

  /// The map has failed its probation: its frames but the reference are used again.
  void rollBack(RollbackReason reason) {
    InitializationRollback rollback = probation_.judgement();
    rollback.frame = last_input_->id();
    rollback.segment = segment_;
    rollback.reason = reason;
    dropMap();
    report_.keyframes = before_.keyframes;
    report_.frames_tracked = before_.frames_tracked;
    report_.segments = before_.segments;
    std::deque<FramePtr> again = probation_.end();
    again.insert(again.end(), waiting_.begin(), waiting_.end());
    waiting_ = std::move(again);
    initializer_->reset();
    phase_ = Phase::kInitializing;
    notify([&](OdometryObserver& o) { o.onInitializationRollback(rollback); });
  }

  /// Into phase lost, which only restart() leaves; within probation the start is given up instead.
  void lose(std::optional<double> rmse) {
    if (probation_.active() && options_.probation.includes_loss && !was_lost_in_probation_) {
      was_lost_in_probation_ = true;
      return rollBack(RollbackReason::kLost);
    }
    waiting_.clear();
    phase_ = Phase::kLost;
    lost_at_ = last_input_->id();
    FrameEstimate estimate = blank(last_input_);
    estimate.tracking_rmse = rmse;
    estimate.state = OdometryState::kLost;
    close(std::move(estimate));
    retireAll();
    notify([&](OdometryObserver& o) { o.onLost(lost_at_, segment_); });
  }

  [[nodiscard]] FrameEstimate blank(const FramePtr& frame) const {
    FrameEstimate estimate;
    estimate.frame = frame;
    estimate.segment = segment_;
    return estimate;
  }

  [[nodiscard]] FramePtr nextWaiting() {
    FramePtr frame = std::move(waiting_.front());
    waiting_.pop_front();
    return frame;
  }

  /// Ends mapping. @return the keyframes of the window
  std::vector<KeyframeSnapshot> dropMap() {
    mapping_.discard();
    keyframe_is_due_ = false;
    return mapper_.clear();
  }

  void notifyRetired(std::vector<KeyframeSnapshot>& keyframes) {
    for (KeyframeSnapshot& keyframe : keyframes) {
      keyframe.segment = segment_;
      notify([&](OdometryObserver& o) { o.onKeyframeRetired(keyframe); });
    }
  }

  void retireAll() {
    probation_.end();
    std::vector<KeyframeSnapshot> keyframes = dropMap();
    notifyRetired(keyframes);
  }

  template <typename Function>
  void notify(const Function& call) {
    for (OdometryObserver* observer : observers_) call(*observer);
  }

  OdometryOptions options_;
  TaskArena arena_;
  TaskArena mapping_arena_;  // two threads in one arena of one thread would wait for each other
  std::unique_ptr<Initializer> initializer_;
  odometry::FrameTracker tracker_;
  odometry::Mapper mapper_;  // belongs to mapping_ while that is busy
  odometry::Probation probation_;
  FrameCheck frame_check_;
  std::vector<OdometryObserver*> observers_;

  Phase phase_ = Phase::kInitializing;
  bool is_finished_ = false;
  bool was_lost_in_probation_ = false;  // in this segment
  int segment_ = 0;
  FrameId lost_at_;
  OdometryReport report_;
  OdometryReport before_;         // before the newest initialization
  std::deque<FramePtr> waiting_;  // to be processed: the frame given, behind those used again
  FramePtr last_input_;           // the last one
  FrameEstimate last_estimate_;   // of the frame processed last
  bool keyframe_is_due_ = false;  // a tracked frame on its way becomes one

  // Last: its thread ends before what it works with.
  WorkerQueue<odometry::MappingJob, odometry::MappingResult> mapping_;
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
