// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/reference_pool.h"

#include "dsorb/image/frame_priors.h"

#include "features/feature_matches.h"
#include "features/grey_image.h"
#include "image/cell_grid.h"
#include "init/waiting_frames.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numeric>
#include <utility>
#include <vector>

namespace dsorb::init_orb {
namespace {

/// Share of a reference's features that descriptors find again; fewer are found in any image.
constexpr double kMinFoundShare = 0.05;
/// References whose features are looked for in every frame: the oldest, which has most parallax,
/// and the newest ones. Where nothing starts (a checkerboard) each frame would add one for good.
constexpr std::size_t kMaxFarReferences = 4;
/// Frames before the newest in which they are looked for when that begins.
constexpr int kMaxCaughtUp = 6;
/// Features of a reference closer to another one, or to a corner, are left out [px].
constexpr float kMinDistance = 4;

const Eigen::Vector2f kUnseen = Eigen::Vector2f::Constant(NAN);

int countSeen(const std::vector<Eigen::Vector2f>& found) {
  return static_cast<int>(std::count_if(found.begin(), found.end(), isSeen));
}

bool enoughFound(const std::vector<Eigen::Vector2f>& found) {
  return countSeen(found) >= kMinFoundShare * static_cast<double>(found.size());
}

/// Adds the features that the newest frame shows to the tracks, but where there is one already.
void addFeatures(const std::vector<std::vector<Eigen::Vector2f>>& features,
                 const Frame& image,
                 CornerTracks& tracks) {
  SpacedPlaces taken(image.width(), image.height(), kMinDistance);
  for (const Eigen::Vector2f& place : tracks.positions.front()) taken.add(place);
  for (std::size_t i = 0; i < features.front().size(); ++i) {
    if (!isSeen(features.back()[i]) || !taken.take(features.front()[i])) continue;
    for (std::size_t k = 0; k < features.size(); ++k) {
      tracks.positions[k].push_back(features[k][i]);
    }
  }
}

}  // namespace

ReferencePool::ReferencePool(const OrbOptions& options, int max_waiting_mb, bool flow_only)
    : options_(options),
      flow_only_(flow_only),
      max_waiting_mb_(max_waiting_mb),
      tracks_(options.tracks) {}

int ReferencePool::Reference::seen() const {
  return far.empty() ? 0 : countSeen(far.back());
}

void ReferencePool::start(FramePtr frame) {
  clear();
  tracks_.start(*frame);
  frames_.push_back(std::move(frame));
  described_.emplace_back();
  addReference();
}

void ReferencePool::addReference() {
  Reference reference;
  reference.frame = tracks_.frames() - 1;
  reference.advanced = advanced_;
  reference.corners = tracks_.size();
  references_.push_back(std::move(reference));
}

void ReferencePool::keepEarly(Reference& reference) const {
  const bool first = advanced_ == reference.advanced + 1;
  if (!first && 2 * tracks_.sizeSince(reference.frame) < reference.corners) return;
  reference.early = {frames_.back()->id(), tracks_.matchesFrom(reference.frame)};
}

void ReferencePool::advance(FramePtr frame) {
  tracks_.advance(*frame);
  frames_.push_back(std::move(frame));
  described_.emplace_back();
  ++advanced_;
  for (Reference& reference : references_) keepEarly(reference);
  keepWithinBudget();
  forgetFarReferences();
  for (std::size_t i = 0; i < references_.size(); ++i) {
    const bool wanted = i == 0 || references_.size() - i < kMaxFarReferences;
    if (wanted && (farApart() || !references_[i].far.empty())) findFeatures(references_[i]);
  }
}

/// Those between the oldest and the newest whose features would have to be looked for, too.
void ReferencePool::forgetFarReferences() {
  if (references_.size() <= kMaxFarReferences) return;
  const auto begin = references_.begin() + 1;
  const auto end = references_.end() - static_cast<std::ptrdiff_t>(kMaxFarReferences - 1);
  references_.erase(
      std::remove_if(begin, end, [](const Reference& reference) { return !reference.far.empty(); }),
      end);
}

const DescribedFrame& ReferencePool::described(int frame) {
  const auto f = static_cast<std::size_t>(frame);
  if (!described_[f]) {
    const float gain = gainTowards(tracks_.referenceMean(), *frames_[f]);
    described_[f] = describeFrame(frames_[f], gain);
  }
  return *described_[f];
}

void ReferencePool::findFeatures(Reference& reference) {
  const DescribedFrame& from = described(reference.frame);
  const int newest = tracks_.frames() - 1;
  std::vector<Eigen::Vector2f> found = findAgain(from, described(newest));
  if (reference.far.empty()) {
    // Most often the scene was cut or covered: then the frames between need not be searched.
    if (!enoughFound(found)) return;
    reference.far.push_back(from.positions);
  }
  for (int frame = reference.frame + static_cast<int>(reference.far.size()); frame < newest;
       ++frame) {
    reference.far.push_back(newest - frame <= kMaxCaughtUp
                                ? findAgain(from, described(frame))
                                : std::vector<Eigen::Vector2f>(from.positions.size(), kUnseen));
  }
  reference.far.push_back(std::move(found));
}

bool ReferencePool::lost(const Reference& reference) const {
  if (cut() && (reference.far.empty() || !enoughFound(reference.far.back()))) return true;
  const int least = reference.far.empty() ? options_.min_tracked
                                          : std::max(kMinCornersOfMotion, options_.min_tracked);
  return tracks_.sizeSince(reference.frame) + reference.seen() < least;
}

bool ReferencePool::dropLost() {
  references_.erase(std::remove_if(references_.begin(),
                                   references_.end(),
                                   [&](const Reference& reference) { return lost(reference); }),
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
  const bool due = farApart() || advanced_ - newest_advanced_ >= options_.reference_interval;
  if (options_.reference_interval == 0 || !due) return;
  tracks_.addCorners();
  newest_ = tracks_.frames() - 1;
  newest_advanced_ = advanced_;
  addReference();
}

void ReferencePool::clear() {
  tracks_.clear();
  frames_.clear();
  described_.clear();
  references_.clear();
  newest_ = newest_advanced_ = advanced_ = 0;
}

ReferenceView ReferencePool::view(int reference) const {
  const Reference& from = references_[static_cast<std::size_t>(reference)];
  CornerTracks tracks = tracks_.since(from.frame);
  if (!from.far.empty()) {
    addFeatures(from.far, *frames_[static_cast<std::size_t>(from.frame)], tracks);
  }
  return {{frames_.begin() + from.frame, frames_.end()},
          std::move(tracks),
          from.last,
          from.early,
          !from.far.empty()};
}

bool ReferencePool::mayStartEarly(int reference) const {
  const int frame = references_[static_cast<std::size_t>(reference)].frame;
  const FramePriors* priors = frames_[static_cast<std::size_t>(frame)]->priors();
  return priors != nullptr && priors->depth && tracks_.frames() - frame > 1;
}

std::vector<int> ReferencePool::turns() const {
  std::vector<int> turns(references_.size());
  std::iota(turns.begin(), turns.end(), 0);
  const auto tried = [&](int i) { return references_[static_cast<std::size_t>(i)].tried; };
  if (turns.empty()) return turns;
  std::stable_sort(
      turns.begin() + 1, turns.end(), [&](int a, int b) { return tried(a) < tried(b); });
  return turns;
}

void ReferencePool::remember(int reference, const AttemptSummary& attempt) {
  Reference& from = references_[static_cast<std::size_t>(reference)];
  from.last = attempt;
  if (attempt.tried) from.tried = advanced_;
}

void ReferencePool::forgetUnusedFrames() {
  const int unused = references_.empty() ? newest_ : references_.front().frame;
  tracks_.dropFrames(0, unused);
  frames_.erase(frames_.begin(), frames_.begin() + unused);
  described_.erase(described_.begin(), described_.begin() + unused);
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
    described_.erase(described_.begin() + dropped);
    for (Reference& reference : references_) {
      const int row = dropped - reference.frame;
      if (row > 0 && row < static_cast<int>(reference.far.size())) {
        reference.far.erase(reference.far.begin() + row);
      }
      reference.frame -= reference.frame > dropped ? 1 : 0;
    }
    newest_ -= newest_ > dropped ? 1 : 0;
  }
}

}  // namespace dsorb::init_orb
