// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/correspondences.h"

#include <algorithm>
#include <utility>

namespace dsorb::init_orb {
namespace {

constexpr int kMinMatches = 100;  // fewer: optical flow

}  // namespace

Correspondences::Correspondences(const OrbOptions& options)
    : options_(options), tracks_(options.tracks) {}

void Correspondences::clear() {
  tracks_.clear();
  uses_flow_ = false;
  frames_.clear();
  observations_.clear();
}

void Correspondences::start(FramePtr reference) {
  clear();
  frames_.push_back(std::move(reference));
  observations_.push_back(matches_.start(*frames_.front()));
  if (size() < kMinMatches) changeToFlow();
}

void Correspondences::advance(FramePtr frame) {
  frames_.push_back(std::move(frame));
  if (uses_flow_) {
    tracks_.advance(*frames_.back());
    return;
  }
  observations_.push_back(matches_.find(*frames_.back()));
  if (size() < kMinMatches) changeToFlow();
}

/// Follows corners through the frames given so far.
void Correspondences::changeToFlow() {
  uses_flow_ = true;
  observations_.clear();
  tracks_.start(*frames_.front());
  for (std::size_t k = 1; k < frames_.size(); ++k) tracks_.advance(*frames_[k]);
}

int Correspondences::size() const {
  if (uses_flow_) return tracks_.size();
  return static_cast<int>(
      std::count_if(observations_.back().begin(), observations_.back().end(), isSeen));
}

bool Correspondences::dropLost() {
  return size() < options_.min_tracked ||
         (uses_flow_ && tracks_.survivorShare() < kMinSurvivorShare);
}

std::optional<InitReason> Correspondences::giveUp(InitReason failure) {
  if (failure == InitReason::kSettling || failure == InitReason::kHurried) {
    return std::nullopt;  // nothing is known of the pair
  }
  const bool grows = failure == InitReason::kTooLittleParallax && age(0) < options_.max_frames;
  return grows ? std::nullopt : std::optional(failure);
}

ReferenceView Correspondences::view(int /*reference*/) const {
  if (uses_flow_) return {frames_, tracks_.since(0), {}, true};
  ReferenceView view{frames_, {}, {}, false};
  view.tracks.positions.resize(frames_.size());
  for (std::size_t i = 0; i < observations_.back().size(); ++i) {
    if (!isSeen(observations_.back()[i])) continue;
    for (std::size_t k = 0; k < frames_.size(); ++k) {
      view.tracks.positions[k].push_back(observations_[k][i]);
    }
  }
  return view;
}

}  // namespace dsorb::init_orb
