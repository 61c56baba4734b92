// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/reference_pool.h"

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
    return tracks_.frames() - reference.frame >= options_.max_frames;
  };
  references_.erase(std::remove_if(references_.begin(), references_.end(), expired),
                    references_.end());
  forgetUnusedFrames();
  if (!references_.empty()) return std::nullopt;
  return failure == InitReason::kTooLittleParallax ? failure : InitReason::kTimeout;
}

void ReferencePool::addWhenDue() {
  const int newest_frame = tracks_.frames() - 1;
  if (options_.reference_interval == 0 || newest_frame - newest_ < options_.reference_interval) {
    return;
  }
  tracks_.addCorners();
  references_.push_back({newest_frame, {}});
  newest_ = newest_frame;
}

void ReferencePool::clear() {
  tracks_.clear();
  frames_.clear();
  references_.clear();
  newest_ = 0;
}

ReferenceView ReferencePool::view(int reference) const {
  const Reference& from = references_[static_cast<std::size_t>(reference)];
  return {{frames_.begin() + from.frame, frames_.end()}, tracks_.since(from.frame), from.last, {}};
}

void ReferencePool::forgetUnusedFrames() {
  const int unused = references_.empty() ? newest_ : references_.front().frame;
  tracks_.dropFrames(unused);
  frames_.erase(frames_.begin(), frames_.begin() + unused);
  for (Reference& reference : references_) reference.frame -= unused;
  newest_ -= unused;
}

}  // namespace dsorb::init_orb
