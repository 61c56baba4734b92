// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/reference_pool.h"

#include "dsorb/image/frame_priors.h"

#include "init/waiting_frames.h"

#include <algorithm>
#include <utility>

namespace dsorb::init_orb {

void ReferencePool::start(FramePtr frame) {
  clear();
  tracks_.start(*frame);
  frames_.push_back(std::move(frame));
  references_.emplace_back();
}

void ReferencePool::advance(FramePtr frame) {
  tracks_.advance(*frame);
  frames_.push_back(std::move(frame));
  ++advanced_;
  keepWithinBudget();
}

bool ReferencePool::dropLost() {
  const auto lost = [&](const Reference& reference) {
    return cut() || tracks_.sizeSince(reference.frame) < options_.min_tracked;
  };
  references_.erase(std::remove_if(references_.begin(), references_.end(), lost),
                    references_.end());
  forgetUnusedFrames();
  return references_.empty();
}

std::optional<InitReason> ReferencePool::giveUp(InitReason failure) {
  const auto expired = [&](const Reference& reference) {
    return advanced_ - reference.advanced + 1 >= options_.max_frames;
  };
  references_.erase(std::remove_if(references_.begin(), references_.end(), expired),
                    references_.end());
  forgetUnusedFrames();
  if (!references_.empty()) return std::nullopt;
  return failure == InitReason::kTooLittleParallax ? failure : InitReason::kTimeout;
}

void ReferencePool::addWhenDue() {
  if (options_.reference_interval == 0 ||
      advanced_ - newest_advanced_ < options_.reference_interval) {
    return;
  }
  tracks_.addCorners();
  newest_ = tracks_.frames() - 1;
  newest_advanced_ = advanced_;
  references_.push_back({newest_, advanced_, {}});
}

void ReferencePool::clear() {
  tracks_.clear();
  frames_.clear();
  references_.clear();
  newest_ = newest_advanced_ = advanced_ = 0;
}

ReferenceView ReferencePool::view(int reference) const {
  const Reference& from = references_[static_cast<std::size_t>(reference)];
  return {{frames_.begin() + from.frame, frames_.end()}, tracks_.since(from.frame), from.last, {}};
}

bool ReferencePool::knowsDepth(int reference) const {
  const int frame = references_[static_cast<std::size_t>(reference)].frame;
  const FramePriors* priors = frames_[static_cast<std::size_t>(frame)]->priors();
  return priors != nullptr && priors->depth && tracks_.frames() - frame > 1;
}

void ReferencePool::forgetUnusedFrames() {
  const int unused = references_.empty() ? newest_ : references_.front().frame;
  tracks_.dropFrames(0, unused);
  frames_.erase(frames_.begin(), frames_.begin() + unused);
  for (Reference& reference : references_) reference.frame -= unused;
  newest_ -= unused;
}

/// Forgets frames between the oldest reference and the newest frame, and with them the references
/// that they were.
void ReferencePool::keepWithinBudget() {
  while (frames_.size() > waitingFrames(*frames_.front(), max_waiting_mb_)) {
    const auto dropped = static_cast<int>(
        leastMissed(frames_, [](const FramePtr& frame) -> const Frame& { return *frame; }));
    tracks_.dropFrames(dropped, 1);
    frames_.erase(frames_.begin() + dropped);
    references_.erase(
        std::remove_if(references_.begin(),
                       references_.end(),
                       [&](const Reference& reference) { return reference.frame == dropped; }),
        references_.end());
    for (Reference& reference : references_) reference.frame -= reference.frame > dropped ? 1 : 0;
    newest_ -= newest_ > dropped ? 1 : 0;
  }
}

}  // namespace dsorb::init_orb
