// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/matching_initializer.h"

#include "init/orb/two_view/rotation_only.h"
#include "init/result.h"

#include <stdexcept>
#include <utility>

namespace dsorb::init_orb {
namespace {

constexpr int kMinRotationMatches = 10;  // to tell that a rotation explains them all

}  // namespace

MatchingInitializer::MatchingInitializer(const InitializerOptions& options,
                                         const PinholeCamera& camera)
    : options_(options),
      camera_(camera),
      arena_(options.num_threads),
      frame_check_(camera),
      pair_(options.orb) {}

InitStep MatchingInitializer::addFrame(FramePtr frame) {
  if (spent_) throw std::logic_error("addFrame after a result: call reset() first");
  frame_check_.accept(frame);
  return arena_.run([&] { return advance(std::move(frame)); });
}

void MatchingInitializer::reset() {
  frame_check_ = FrameCheck(camera_);
  pair_.clear();
  clock_.clear();
  resets_.clear();
  spent_ = false;
}

InitStep MatchingInitializer::advance(FramePtr frame) {
  if (pair_.frames() == 0) return waitWithNewReference(std::move(frame), InitReason::kFirstFrame);
  if (pair_.frames() == 1 && pair_.size() < options_.orb.min_tracked) {
    return waitWithNewReference(std::move(frame), InitReason::kTooFewPoints);
  }
  clock_.time("matching", [&] { pair_.advance(frame); });
  if (pair_.lost()) {
    return onlyRotated() ? waitWithNewReference(std::move(frame), InitReason::kTooLittleParallax)
                         : restart(std::move(frame), InitReason::kTrackingLost);
  }
  if (pair_.frames() < options_.orb.min_frames) return needsMoreFrames(InitReason::kSettling);
  Attempt made = attemptFrom(pair_.view(), {camera_, options_, clock_});
  if (made.map) return finish(std::move(made));
  if (made.reason != InitReason::kTooLittleParallax) return restart(std::move(frame), made.reason);
  return pair_.frames() < options_.orb.max_frames
             ? needsMoreFrames(made.reason)
             : waitWithNewReference(std::move(frame), made.reason);
}

/// Whether points left the image because the camera turned: that is no failure.
bool MatchingInitializer::onlyRotated() const {
  const CornerTracks points = pair_.view().tracks;
  return points.size() >= kMinRotationMatches &&
         rotationResidualDeg(points.matchesTo(points.frames() - 1), camera_) <
             kMinRotationResidualDeg;
}

InitStep MatchingInitializer::finish(Attempt attempt) {
  attempt.report.details.emplace_back("optical_flow", pair_.usesFlow() ? 1 : 0);
  spent_ = true;
  return resets_.finish(toResult(std::move(attempt)), clock_);
}

InitStep MatchingInitializer::waitWithNewReference(FramePtr frame, InitReason reason) {
  clock_.time("matching", [&] { pair_.start(std::move(frame)); });
  return needsMoreFrames(reason);
}

InitStep MatchingInitializer::restart(FramePtr frame, InitReason reason) {
  clock_.time("matching", [&] { pair_.start(std::move(frame)); });
  return resets_.restart(reason);
}

}  // namespace dsorb::init_orb
