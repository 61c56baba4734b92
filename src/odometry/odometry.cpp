// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/odometry/odometry.h"

#include "dsorb/odometry/observer.h"

#include "base/describe.h"
#include "base/parallel.h"
#include "base/timed.h"
#include "image/contrast.h"
#include "image/frame_check.h"
#include "odometry/frame_tracker.h"
#include "odometry/mapper.h"
#include "odometry/segment_unit.h"

#include <algorithm>
#include <cstddef>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace dsorb::odometry {

/// The observers of a run, called in the order in which they were added.
class Observers {
 public:
  /// @throws std::invalid_argument for a null pointer
  void add(OdometryObserver* observer) {
    if (observer == nullptr) throw std::invalid_argument("observer is null");
    observers_.push_back(observer);
  }
  /// Calls a method of every observer; one that is added by such a call hears of what comes then.
  template <typename Method, typename... Values>
  void notify(Method method, const Values&... values) const {
    const std::size_t count = observers_.size();
    for (std::size_t i = 0; i < count; ++i) (observers_[i]->*method)(values...);
  }
  /// Calls a method of every observer with the first keyframe, then with the next one.
  template <typename Method>
  void notifyEach(Method method, const std::vector<KeyframeSnapshot>& keyframes) const {
    for (const KeyframeSnapshot& keyframe : keyframes) notify(method, keyframe);
  }

 private:
  std::vector<OdometryObserver*> observers_;
};

namespace {

/// What is told of a frame without a pose.
FrameEstimate estimateWithoutPose(const FramePtr& frame,
                                  int segment,
                                  OdometryState state,
                                  std::optional<double> tracking_rmse) {
  FrameEstimate estimate;
  estimate.frame = frame;
  estimate.segment = segment;
  estimate.state = state;
  estimate.tracking_rmse = tracking_rmse;
  return estimate;
}

/// What is told of a tracked frame, in the segment's own unit.
FrameEstimate trackedEstimate(const FramePtr& frame, int segment, const TrackedPose& pose) {
  FrameEstimate estimate = estimateWithoutPose(frame, segment, OdometryState::kTracked, pose.rmse);
  estimate.T_world_cam = pose.T_cam_world.inverse();
  estimate.keyframe = pose.keyframe;
  estimate.T_cam_keyframe = pose.T_cam_keyframe;
  estimate.covariance = pose.covariance;
  estimate.world_covariance = pose.world_covariance;
  estimate.affine = pose.affine;
  return estimate;
}

/// What is told of a frame that was recognized, in the unit of the place.
FrameEstimate recognizedEstimate(const FramePtr& frame, const RecognizedPlace& place) {
  FrameEstimate estimate =
      estimateWithoutPose(frame, place.segment, OdometryState::kTracked, std::nullopt);
  estimate.T_world_cam = place.T_world_cam;
  estimate.keyframe = place.keyframe;
  estimate.T_cam_keyframe = place.T_cam_keyframe;
  estimate.covariance = place.covariance;
  estimate.world_covariance = place.covariance;
  return estimate;
}

/// What is told of a tracked frame where mapping has made the newest keyframe of it: its pose is
/// that after adjustment.
FrameEstimate adjustedEstimate(FrameEstimate estimate, const FrameTracker& tracker) {
  const track::TrackingReference& newest = tracker.reference();
  if (estimate.frame != newest.frame) return estimate;
  estimate.T_world_cam = tracker.target().T_cam_world.inverse();
  estimate.affine = newest.affine;
  if (!estimate.keyframe) {  // of an initialization
    estimate.keyframe = estimate.frame->id();
    estimate.T_cam_keyframe = SE3();
  }
  return estimate;
}

}  // namespace
}  // namespace dsorb::odometry

namespace dsorb {
namespace {

/// With the camera refined where it is a guess.
OdometryOptions checked(OdometryOptions options, const PinholeCamera& camera) {
  options.initializer.num_threads = options.num_threads;
  if (camera.focal_sigma > 0 && options.window.prior.focal_sigma == 0) {
    options.window.optimizer.optimize_intrinsics = true;
    options.window.prior.focal_sigma = camera.focal_sigma;
  }
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

/// The same image with other priors.
FramePtr withPriors(const FramePtr& frame, FramePriors priors) {
  FrameInfo info;
  info.id = frame->id();
  info.timestamp = frame->timestamp();
  info.exposure = frame->exposure();
  info.response_slope = {frame, frame->responseSlope()};  // lives as long as the frame
  info.row_times = {frame, frame->rowTimes()};
  info.priors = std::make_shared<const FramePriors>(std::move(priors));
  const PyramidLevel& image = frame->level(0);
  std::vector<float> pixels;
  for (int y = 0; y < image.height(); ++y) {
    pixels.insert(pixels.end(), image.row(y), image.row(y) + image.width());
  }
  return Frame::create(ImageView(pixels.data(), image.width(), image.height()), info);
}

}  // namespace

/// The phases of a run.
class Odometry::Impl {
 public:
  Impl(const PinholeCamera& camera,
       const OdometryOptions& options,
       std::unique_ptr<Initializer> initializer)
      : options_(checked(options, camera)),
        frame_check_(camera),
        arena_(options_.num_threads),
        initializer_(std::move(initializer)),
        tracker_(options_),
        mapper_(camera, options_, arena_) {
    if (initializer_ == nullptr) initializer_ = makeInitializer(options_.initializer, camera);
  }

  void addObserver(OdometryObserver* observer) { observers_.add(observer); }

  void setRecognizer(Recognizer recognizer, int first_segment) {
    recognizer_ = std::move(recognizer);
    segment_ = std::max(segment_, first_segment);
  }

  FrameEstimate process(const FramePtr& given, bool hurried) {
    accept(given);
    const FramePtr frame = inUsualGrey(given);
    initializer_->setHurried(hurried);
    const bool repeats = shown_ && isRepeated(*frame, *shown_);
    if (!repeats) shown_ = frame;
    if (!adoptKeyframes()) {
      lose({});
    } else if (repeats) {
      repeat(frame);
    } else if (phase_ == Phase::kInitializing) {
      initialize(frame);
    } else {
      track(frame);
    }
    return last_estimate_;
  }

  void restart() {
    if (is_finished_) throw std::logic_error("Odometry::restart after finish()");
    finishMapping();
    const bool was_placed = phase_ != Phase::kInitializing;
    retireAll();
    if (was_placed) ++segment_;
    refusals_ = 0;
    initializer_->reset();
    place_.reset();
    shown_.reset();
    grey_scale_.reset();
    frame_check_.restart();
    phase_ = Phase::kInitializing;
  }

  OdometryReport finish() {
    if (is_finished_) return report_;
    finishMapping();
    is_finished_ = true;
    retireAll();
    return report_;
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
  }

  /// The frame in the grey levels that thresholds are meant in: the first image with something to
  /// see decides for all that follow, or, while nothing has started, the first that this does not
  /// suit.
  FramePtr inUsualGrey(const FramePtr& frame) {
    if (options_.initializer.skip.has(Mechanism::kContrast)) return frame;
    if (phase_ == Phase::kInitializing && grey_scale_ && !grey_scale_->suits(*frame)) {
      grey_scale_.reset();
      place_.reset();
      initializer_->reset();
    }
    if (!grey_scale_) grey_scale_ = GreyScale::of(*frame);
    return grey_scale_ && grey_scale_->changes() ? grey_scale_->apply(frame) : frame;
  }

  /// An image that repeats the one before tells nothing new: it has the same answer, at no cost.
  void repeat(const FramePtr& frame) {
    FrameEstimate estimate = std::move(last_estimate_);
    estimate.is_keyframe = false;
    if (estimate.T_world_cam && estimate.frame == tracker_.reference().frame) {
      estimate.keyframe = estimate.frame->id();
      estimate.T_cam_keyframe = SE3();
    }
    estimate.frame = frame;
    estimate.repeats = shown_->id();
    if (estimate.state == OdometryState::kInitialized) estimate.state = OdometryState::kTracked;
    if (estimate.state == OdometryState::kTracked) ++report_.frames_tracked;
    if (estimate.state == OdometryState::kMissed) ++report_.frames_missed;
    last_estimate_ = std::move(estimate);
    observers_.notify(&OdometryObserver::onFrame, last_estimate_);
  }

  /// Phase initializing: feeds the initializer; its result becomes the first map.
  void initialize(const FramePtr& frame) {
    const InitStep step = timed(report_.initializing_seconds,
                                [&] { return initializer_->addFrame(recognized(frame)); });
    const bool begins_anew = step.status == InitStatus::kRestarted;
    if (begins_anew || (step.result && !isOfPlace(*step.result))) place_.reset();
    proceed(step, frame);
  }

  /// What the initializer answers is told; a map begins with its result.
  void proceed(const InitStep& step, const FramePtr& frame) {
    unit_ = unitOf(step);
    try {
      checkStep(step);
      observers_.notify(&OdometryObserver::onInitStep, step, *frame, unit_.told(segment_));
    } catch (...) {
      if (step.result) initializer_->reset();
      throw;
    }
    last_estimate_ =
        odometry::estimateWithoutPose(frame, segment_, OdometryState::kInitializing, {});
    if (step.result) {
      begin(*step.result);
    } else {
      observers_.notify(&OdometryObserver::onFrame, last_estimate_);
    }
  }

  /// A frame as the initializer gets it: the reference of a new start where its place is known.
  FramePtr recognized(const FramePtr& frame) {
    if (!recognizer_ || place_) return frame;
    std::optional<RecognizedPlace> found = placeOf(*frame);
    return found ? referenceAt(*std::move(found), frame) : frame;
  }

  [[nodiscard]] std::optional<RecognizedPlace> placeOf(const Frame& frame) const {
    std::optional<RecognizedPlace> found = recognizer_(frame);
    return found && !found->depths.empty() ? std::move(found) : std::nullopt;
  }

  /// The frame with what its place knows of it, for a start that begins with it.
  FramePtr referenceAt(RecognizedPlace found, const FramePtr& frame) {
    FramePriors priors = frame->priors() == nullptr ? FramePriors() : *frame->priors();
    priors.depth = sparseDepth(frame->width(), frame->height(), found.depths);
    place_ = std::move(found);
    place_frame_ = frame->id();
    initializer_->reset();
    return withPriors(frame, std::move(priors));
  }

  /// Looks for a frame that the newest keyframe does not show among all places of before: it has
  /// the pose that it is recognized at, and a start from there goes on beside the map that it was
  /// lost from, until one of both tracks.
  /// @return whether the frame has a pose
  bool recognizeMissed(const FramePtr& frame) {
    if (!recognizer_) return false;
    const std::optional<RecognizedPlace> found = placeOf(*frame);
    if (!found && !place_) return false;
    const InitStep step = timed(report_.initializing_seconds, [&] {
      return initializer_->addFrame(place_ ? frame : referenceAt(*found, frame));
    });
    if (step.result && isOfPlace(*step.result)) {
      retireAll();
      ++segment_;
      phase_ = Phase::kInitializing;
      proceed(step, frame);
      return true;
    }
    if (step.result || step.status == InitStatus::kRestarted) forgetPlace();
    if (found) {
      ++report_.frames_tracked;
      last_estimate_ = odometry::recognizedEstimate(frame, *found);
      observers_.notify(&OdometryObserver::onFrame, last_estimate_);
    }
    return found.has_value();
  }

  /// The map that was lost tracks again, or another one begins.
  void forgetPlace() {
    if (!place_) return;
    place_.reset();
    initializer_->reset();
  }

  /// Whether a start has the unit of the place that was recognized.
  [[nodiscard]] bool isOfPlace(const InitializationResult& result) const {
    return place_ && result.metric && result.frames.front().frame->id() == place_frame_;
  }

  [[nodiscard]] odometry::SegmentUnit unitOf(const InitStep& step) const {
    if (!step.result) return {};
    if (!place_) return odometry::SegmentUnit(step.result->metric);
    return {step.result->metric, place_->segment, place_->T_world_cam};
  }

  /// @throws what mapping threw; the map is lost then
  template <typename Call>
  auto mapping(const Call& call) {
    try {
      return call();
    } catch (...) {
      phase_ = Phase::kLost;
      throw;
    }
  }

  /// Phase tracking begins with the map of an initialization, unless that contradicts it.
  void begin(const InitializationResult& result) {
    odometry::MappingResult seeded = mapping([&] { return mapper_.seed(result, segment_); });
    const odometry::MapUpdate& update = *seeded.update;
    const std::optional<RefusalReason> reason =
        update.finite ? refusalOf(update.start_change) : std::optional(RefusalReason::kAdjustment);
    if (reason && (!update.finite || refusals_ < options_.max_refusals)) {
      report_.mapping_seconds += seeded.seconds;
      refuse(
          {result.frames.back().frame->id(), unit_.told(segment_), *reason, update.start_change});
      return;
    }
    refusals_ = 0;
    doubted_ = 0;
    phase_ = Phase::kTracking;
    ++(place_ ? report_.recognized : report_.segments);
    place_.reset();
    tracker_.begin(result);
    adopt(std::move(seeded));
    FrameEstimate estimate = last_estimate_;
    estimate.state = OdometryState::kInitialized;
    estimate.is_keyframe = true;
    conclude(std::move(estimate));
  }

  /// The initializer begins anew with the next frame.
  void refuse(const StartRefusal& refusal) {
    ++refusals_;
    place_.reset();
    mapper_.clear();
    initializer_->reset();
    observers_.notify(&OdometryObserver::onStartRefused, refusal);
    observers_.notify(&OdometryObserver::onFrame, last_estimate_);
  }

  /// Phase tracking: pose of one frame, which then goes into the map.
  void track(const FramePtr& frame) {
    odometry::TrackedPose pose = poseOf(frame);
    if (!pose.good && mapper_.busy()) {  // once more, against a newer keyframe
      mapper_.wait();
      if (!adoptKeyframes()) {
        lose({});
        return;
      }
      pose = poseOf(frame);
    }
    if (!pose.good) {
      if (!recognizeMissed(frame)) miss(pose.rmse);
      return;
    }
    forgetPlace();
    doubted_ = pose.fits ? 0 : doubted_ + 1;
    FrameEstimate estimate = odometry::trackedEstimate(frame, segment_, pose);
    estimate.is_keyframe = pose.wants_keyframe && !mapper_.keyframeIsDue();
    if (pose.fits) mapper_.submit({frame, std::move(pose), estimate.is_keyframe});
    bool stands = true;
    try {
      stands = adoptKeyframes();
    } catch (...) {  // the frame is tracked all the same
      concludeTracked(std::move(estimate));
      throw;
    }
    if (stands) {
      concludeTracked(std::move(estimate));
    } else {
      lose({});
    }
  }

  /// The map stands for some frames without a pose.
  void miss(std::optional<double> tracking_rmse) {
    if (doubted_ >= options_.max_missed) {
      lose(tracking_rmse);
      return;
    }
    ++doubted_;
    ++report_.frames_missed;
    concludeWithoutPose(OdometryState::kMissed, tracking_rmse);
  }

  void concludeWithoutPose(OdometryState state, std::optional<double> tracking_rmse) {
    last_estimate_ =
        odometry::estimateWithoutPose(last_input_, unit_.told(segment_), state, tracking_rmse);
    observers_.notify(&OdometryObserver::onFrame, last_estimate_);
  }

  [[nodiscard]] odometry::TrackedPose poseOf(const FramePtr& frame) {
    return timed(report_.tracking_seconds, [&] {
      return arena_.run([&] { return tracker_.track(frame, doubted_ < options_.max_missed); });
    });
  }

  void concludeTracked(FrameEstimate estimate) {
    ++report_.frames_tracked;
    conclude(std::move(estimate));
  }

  /// Tells of a frame with a pose.
  void conclude(FrameEstimate estimate) {
    last_estimate_ = unit_.told(odometry::adjustedEstimate(std::move(estimate), tracker_));
    observers_.notify(&OdometryObserver::onFrame, last_estimate_);
  }

  /// Adopts all keyframes that mapping has finished. @return whether the map stands
  bool adoptKeyframes() {
    while (auto result = mapping([&] { return mapper_.take(); })) {
      if (!adopt(std::move(*result))) return false;
    }
    return true;
  }

  /// Later frames are tracked against the newest keyframe. @return false: its adjustment failed
  bool adopt(odometry::MappingResult result) {
    report_.mapping_seconds += result.seconds;
    if (!result.update) return true;
    odometry::MapUpdate& update = *result.update;
    report_.keyframes += update.new_keyframes;
    if (!update.finite) return false;
    tracker_.setTarget(std::move(update.target));
    observers_.notifyEach(&OdometryObserver::onKeyframeRetired, unit_.told(update.retired));
    observers_.notifyEach(&OdometryObserver::onKeyframe, unit_.told(update.window));
    return true;
  }

  void finishMapping() {
    mapper_.wait();
    if (!adoptKeyframes()) loseMap();
  }

  /// The newest frame is lost.
  void lose(std::optional<double> tracking_rmse) {
    concludeWithoutPose(OdometryState::kLost, tracking_rmse);
    loseMap();
  }

  /// Into phase lost, which only restart() leaves.
  void loseMap() {
    phase_ = Phase::kLost;
    retireAll();
    observers_.notify(&OdometryObserver::onLost, last_input_->id(), unit_.told(segment_));
  }

  void retireAll() {
    observers_.notifyEach(&OdometryObserver::onKeyframeRetired, unit_.told(mapper_.clear()));
  }

  OdometryOptions options_;
  FrameCheck frame_check_;
  TaskArena arena_;
  std::unique_ptr<Initializer> initializer_;
  odometry::FrameTracker tracker_;
  odometry::AsyncMapper mapper_;
  odometry::Observers observers_;

  Phase phase_ = Phase::kInitializing;
  bool is_finished_ = false;
  int segment_ = 0;
  odometry::SegmentUnit unit_;
  Recognizer recognizer_;
  std::optional<RecognizedPlace> place_;  // of the reference of the start that is under way
  FrameId place_frame_;
  int refusals_ = 0;  // in a row
  int doubted_ = 0;   // frames in a row without a pose, or with one that does not fit
  OdometryReport report_;
  FramePtr last_input_;
  std::optional<GreyScale> grey_scale_;  // of the images
  FramePtr shown_;                       // the last one that did not repeat another
  FrameEstimate last_estimate_;
};

const char* name(OdometryState state) {
  switch (state) {
    case OdometryState::kInitializing:
      return "initializing";
    case OdometryState::kInitialized:
      return "initialized";
    case OdometryState::kTracked:
      return "tracked";
    case OdometryState::kLost:
      return "lost";
    case OdometryState::kMissed:
      return "missed";
  }
  return "unknown";
}

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

void Odometry::setRecognizer(Recognizer recognizer, int first_segment) {
  impl_->setRecognizer(std::move(recognizer), first_segment);
}

FrameEstimate Odometry::process(const FramePtr& frame, bool hurried) {
  return impl_->process(frame, hurried);
}

void Odometry::restart() {
  impl_->restart();
}

OdometryReport Odometry::finish() {
  return impl_->finish();
}

}  // namespace dsorb
