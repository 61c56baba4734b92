// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/frame.h"
#include "dsorb/init/report.h"
#include "dsorb/options/orb.h"

#include "features/feature_matches.h"
#include "features/feature_tracks.h"
#include "init/orb/map/attempt_types.h"

#include <optional>
#include <vector>

namespace dsorb::init_orb {

/// References whose corners are followed from frame to frame: one only, or a sliding pool with a
/// new one every few frames, because a fast camera loses its tracks before a slow one has parallax.
/// Where optical flow loses more than it keeps, features of the references are found again by
/// their descriptors as well, from then on: without this starts from frames far apart take
/// 1.15 +- .06 times as many images.
class ReferencePool {
 public:
  /// @param max_waiting_mb for the frames; beyond it those between are forgotten [MiB]
  /// @param flow_only whether corners that optical flow loses are not found again
  ReferencePool(const OrbOptions& options, int max_waiting_mb, bool flow_only = false);

  /// Forgets everything; the frame becomes the only reference.
  void start(FramePtr frame);
  /// Finds the corners of all references in the next frame.
  void advance(FramePtr frame);
  /// Makes the newest frame another reference when one is due.
  void addWhenDue();
  void clear();

  [[nodiscard]] bool empty() const { return frames_.empty(); }
  /// The frame given last; there is one unless empty().
  [[nodiscard]] const Frame& newest() const { return *frames_.back(); }
  /// Whether the first reference has too few corners to follow.
  [[nodiscard]] bool tooFewCorners() const {
    return references() == 1 && tracks(0) < options_.min_tracked;
  }
  /// Drops references with too few live tracks, and all at a scene cut.
  /// @return whether none is left
  bool dropLost();
  /// Gives up references that have waited too long.
  /// @param failure of the attempt from the oldest one
  /// @return        the reason when none is left
  std::optional<InitReason> giveUp(InitReason failure);

  [[nodiscard]] int references() const { return static_cast<int>(references_.size()); }
  /// Frames since a reference, both counted. @param reference oldest first
  [[nodiscard]] int age(int reference) const {
    return advanced_ - references_[static_cast<std::size_t>(reference)].advanced + 1;
  }
  /// Live tracks of a reference, and features of it that the newest frame shows.
  [[nodiscard]] int tracks(int reference) const {
    const Reference& from = references_[static_cast<std::size_t>(reference)];
    return tracks_.sizeSince(from.frame) + from.seen();
  }
  [[nodiscard]] ReferenceView view(int reference) const;
  /// Whether a reference may start with fewer than OrbOptions::min_frames: the caller knows depths
  /// of it, and a later frame is there.
  [[nodiscard]] bool mayStartEarly(int reference) const;
  /// The oldest, which has most parallax, then those that have waited longest.
  [[nodiscard]] std::vector<int> turns() const;
  void remember(int reference, const AttemptSummary& attempt);
  /// Tracks of the newest reference, lost or not; empty after a scene cut.
  [[nodiscard]] CornerTracks newestTracks() const {
    return cut() ? CornerTracks() : tracks_.since(newest_);
  }

 private:
  struct Reference {
    int frame = 0;     // index of frames_
    int advanced = 0;  // of the pool when it was the newest frame
    AttemptSummary last;
    int tried = 0;    // of the pool when it was tried last
    int corners = 0;  // when it became one
    EarlyMatches early{};
    /// Positions of its features, frame by frame from itself on [px]; empty while optical flow
    /// suffices.
    std::vector<std::vector<Eigen::Vector2f>> far{};

    /// Features that the newest frame shows.
    [[nodiscard]] int seen() const;
  };

  /// Whether most tracks ended with the last step.
  [[nodiscard]] bool cut() const { return tracks_.survivorShare() < kMinSurvivorShare; }
  /// Whether more tracks ended with the last step than went on.
  [[nodiscard]] bool farApart() const {
    return !flow_only_ && tracks_.survivorShare() < kMinKeptShare;
  }
  [[nodiscard]] bool lost(const Reference& reference) const;
  /// Makes the newest frame one.
  void addReference();
  /// Keeps its matches while half of its corners live, and those with the first frame after it.
  void keepEarly(Reference& reference) const;
  void forgetUnusedFrames();
  void forgetFarReferences();
  void keepWithinBudget();
  const DescribedFrame& described(int frame);
  /// Finds the features of a reference in the frames that they are not yet found in.
  void findFeatures(Reference& reference);

  OrbOptions options_;
  bool flow_only_;
  int max_waiting_mb_;
  FeatureTracks tracks_;
  std::vector<FramePtr> frames_;                          // since the oldest reference
  std::vector<std::optional<DescribedFrame>> described_;  // those of them that had to be
  std::vector<Reference> references_;                     // oldest first
  int newest_ = 0;           // index of the newest reference, lost or not
  int newest_advanced_ = 0;  // of the pool when it was the newest frame
  int advanced_ = 0;         // frames given after the first
};

}  // namespace dsorb::init_orb
