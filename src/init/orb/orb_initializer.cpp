// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/orb_initializer.h"

#include "init/orb/two_view/rotation_only.h"

#include <stdexcept>
#include <utility>

namespace dsorb::init_orb {
namespace {

constexpr int kMaxAttempts = 2;         // with one frame, oldest references first
constexpr int kMinRotationTracks = 10;  // to tell that a rotation explains them all

}  // namespace

ORBInitializer::ORBInitializer(const InitializerOptions& options, const PinholeCamera& camera)
    : options_(options),
      camera_(camera),
      arena_(options.num_threads),
      frame_check_(camera),
      pool_(options.orb) {}

InitStep ORBInitializer::addFrame(FramePtr frame) {
  if (spent_) throw std::logic_error("addFrame after a result: call reset() first");
  frame_check_.accept(frame);
  return arena_.run([&] { return advance(std::move(frame)); });
}

void ORBInitializer::reset() {
  pool_.clear();
  clock_.clear();
  resets_.clear();
  frame_check_ = FrameCheck(camera_);
  spent_ = false;
}

/// One step of algorithm 1.
InitStep ORBInitializer::advance(FramePtr frame) {
  if (pool_.empty()) {
    takeReference(std::move(frame));
    return needsMoreFrames(InitReason::kFirstFrame);
  }
  if (pool_.references() == 1 && pool_.tracks(0) < options_.orb.min_tracked) {
    return waitWithNewReference(std::move(frame), InitReason::kTooFewPoints);
  }
  clock_.time("tracking", [&] { pool_.advance(frame); });
  if (pool_.dropLost()) {
    return onlyRotated() ? waitWithNewReference(std::move(frame), InitReason::kTooLittleParallax)
                         : restart(std::move(frame), InitReason::kTrackingLost);
  }
  Attempt made = attempt();
  if (made.map) return finish(std::move(made));
  if (pool_.dropExpired()) {
    return made.reason == InitReason::kTooLittleParallax
               ? waitWithNewReference(std::move(frame), made.reason)
               : restart(std::move(frame), InitReason::kTimeout);
  }
  clock_.time("corners", [&] { pool_.addWhenDue(); });
  return needsMoreFrames(made.reason);
}

Attempt ORBInitializer::attempt() {
  Attempt first;  // its reason is the answer when none succeeds
  int tried = 0;
  for (int reference = 0; reference < pool_.references(); ++reference) {
    if (pool_.age(reference) < options_.orb.min_frames) break;
    if (tried == kMaxAttempts) break;
    Attempt next = attemptFrom(pool_.view(reference), {camera_, options_, clock_});
    if (next.map) return next;
    pool_.remember(reference, next.evidence);
    tried += next.evidence.tried ? 1 : 0;
    if (reference == 0) first = std::move(next);
  }
  return first;
}

/// Whether the tracks left the image because the camera turned: nothing is lost then.
bool ORBInitializer::onlyRotated() const {
  const CornerTracks tracks = pool_.newestTracks();
  if (tracks.size() < kMinRotationTracks || pool_.survivorShare() < kMinSurvivorShare) {
    return false;
  }
  return rotationResidualDeg(tracks.matchesTo(tracks.frames() - 1), camera_) <
         kMinRotationResidualDeg;
}

void ORBInitializer::takeReference(FramePtr frame) {
  clock_.time("corners", [&] { pool_.start(std::move(frame)); });
}

InitStep ORBInitializer::waitWithNewReference(FramePtr frame, InitReason reason) {
  takeReference(std::move(frame));
  return needsMoreFrames(reason);
}

InitStep ORBInitializer::restart(FramePtr frame, InitReason reason) {
  takeReference(std::move(frame));
  return resets_.restart(reason);
}

InitStep ORBInitializer::finish(Attempt attempt) {
  spent_ = true;
  return resets_.finish(toResult(std::move(attempt)), clock_);
}

}  // namespace dsorb::init_orb
