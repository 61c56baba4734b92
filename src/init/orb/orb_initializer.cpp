// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/orb_initializer.h"

#include "image/contrast.h"
#include "init/orb/reference_pool.h"
#include "two_view/rotation_only.h"

#include <optional>
#include <stdexcept>
#include <utility>

namespace dsorb::init_orb {
namespace {

constexpr int kMinRotationTracks = 10;  // needed to tell that a rotation explains them
constexpr int kMaxAttempts = 2;         // with one frame
constexpr int kMaxBlank = 3;            // frames in a row that are passed over
constexpr int kMaxPutOff = 10;          // attempts in a row, of a caller who is always in a hurry

void keepSurest(const std::optional<WaitingMotion>& motion, std::optional<WaitingMotion>& surest) {
  if (!motion) return;
  if (!surest || motion->wrong_probability < surest->wrong_probability) surest = motion;
}

std::unique_ptr<ReferencePool> makePool(const InitializerOptions& options) {
  OrbOptions orb = options.orb;
  if (options.skip.has(Mechanism::kPool)) orb.reference_interval = 0;
  return std::make_unique<ReferencePool>(
      orb, options.max_waiting_mb, options.skip.has(Mechanism::kFar));
}

}  // namespace

ORBInitializer::ORBInitializer(const InitializerOptions& options, const PinholeCamera& camera)
    : options_(options),
      camera_(camera),
      arena_(options.num_threads),
      frame_check_(camera),
      source_(makePool(options)) {}

InitStep ORBInitializer::addFrame(FramePtr frame) {
  if (spent_) throw std::logic_error("addFrame after a result: call reset() first");
  frame_check_.accept(frame);
  return arena_.run([&] { return advance(std::move(frame)); });
}

void ORBInitializer::reset() {
  source_->clear();
  clock_.clear();
  resets_.clear();
  frame_check_.restart();
  spent_ = false;
  blank_ = 0;
  put_off_ = 0;
}

InitStep ORBInitializer::advance(FramePtr frame) {
  if (source_->empty()) {
    return startOver(std::move(frame), needsMoreFrames(InitReason::kFirstFrame));
  }
  if (source_->tooFewCorners()) {
    return startOver(std::move(frame), needsMoreFrames(InitReason::kTooFewPoints));
  }
  if (!options_.skip.has(Mechanism::kBlank) && blank_ < kMaxBlank &&
      isBlank(*frame, source_->newest())) {
    ++blank_;
    return needsMoreFrames(InitReason::kTooFewPoints);
  }
  blank_ = 0;
  clock_.time("tracking", [&] { source_->advance(frame); });
  if (source_->dropLost()) {
    return startOver(std::move(frame),
                     onlyRotated() ? needsMoreFrames(InitReason::kTooLittleParallax)
                                   : resets_.restart(InitReason::kTrackingLost));
  }
  Attempt attempt = tryReferences();
  if (attempt.made) {
    InitStep started = resets_.finish(toResult(std::move(*attempt.made)), clock_);
    spent_ = true;
    return started;
  }
  const InitReason failure = attempt.made.reason();
  if (const auto reason = source_->giveUp(failure)) {
    return startOver(std::move(frame),
                     *reason == InitReason::kTooLittleParallax ? needsMoreFrames(*reason)
                                                               : resets_.restart(*reason));
  }
  clock_.time("corners", [&] { source_->addWhenDue(); });
  InitStep step = needsMoreFrames(failure);
  step.motion = attempt.motion;
  return step;
}

Attempt ORBInitializer::tryReferences() {
  Attempt first;  // its reason is the answer when none succeeds
  if (hurried_ && put_off_ < kMaxPutOff) {
    ++put_off_;
    first.made = InitReason::kHurried;
    return first;
  }
  put_off_ = 0;
  std::optional<WaitingMotion> surest;
  int tried = 0;
  for (const int reference : source_->turns()) {
    if (tried == kMaxAttempts) break;
    if (source_->age(reference) < options_.orb.min_frames && !source_->mayStartEarly(reference)) {
      continue;
    }
    Attempt next = attemptFrom(source_->view(reference), {camera_, options_, clock_});
    if (next.made) return next;
    source_->remember(reference, next.summary);
    tried += next.summary.tried ? 1 : 0;
    keepSurest(next.motion, surest);
    if (reference == 0) first = std::move(next);
  }
  first.motion = surest;
  return first;
}

/// Whether the corners left the image only because the camera rotated.
bool ORBInitializer::onlyRotated() const {
  const CornerTracks tracks = source_->newestTracks();
  return tracks.size() >= kMinRotationTracks &&
         rotationResidualDeg(tracks.matchesTo(tracks.frames() - 1), camera_) <
             kMinRotationResidualDeg;
}

InitStep ORBInitializer::startOver(FramePtr frame, InitStep step) {
  clock_.time("corners", [&] { source_->start(std::move(frame)); });
  return step;
}

}  // namespace dsorb::init_orb
