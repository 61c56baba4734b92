// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/frame.h"
#include "dsorb/options/orb.h"

#include "init/orb/map/reference_view.h"
#include "init/orb/tracks/corner_tracks.h"
#include "init/orb/tracks/feature_tracks.h"

#include <vector>

namespace dsorb::init_orb {

/// The frames an initializer may start from: one only, or a sliding pool with a new one every few
/// frames, because a fast camera loses its tracks before a slow one has parallax.
/// @source experiments on KITTI, EuRoC, TartanAir and 7-Scenes: more starts within 10 degrees
class ReferencePool {
 public:
  explicit ReferencePool(const OrbOptions& options) : options_(options), tracks_(options.tracks) {}

  /// Forgets everything; the frame becomes the only reference.
  void start(FramePtr frame);
  /// Follows the corners of all references into the next frame.
  void advance(FramePtr frame);
  /// Drops references with too few tracks, and all at a scene cut. @return whether none is left
  bool dropLost();
  /// Drops references that have waited too long. @return whether none is left
  bool dropExpired();
  /// Makes the newest frame a reference when it is time for one.
  void addWhenDue();
  void clear();

  [[nodiscard]] bool empty() const { return frames_.empty(); }
  [[nodiscard]] int references() const { return static_cast<int>(references_.size()); }
  /// Frames since a reference, both counted. @param reference oldest first
  [[nodiscard]] int age(int reference) const {
    return tracks_.frames() - references_[static_cast<std::size_t>(reference)].frame;
  }
  /// Live tracks of a reference.
  [[nodiscard]] int tracks(int reference) const {
    return tracks_.sizeSince(references_[static_cast<std::size_t>(reference)].frame);
  }
  /// Share of the tracks that survived the last step.
  [[nodiscard]] double survivorShare() const { return tracks_.survivorShare(); }
  [[nodiscard]] ReferenceView view(int reference) const;
  void remember(int reference, const MotionEvidence& evidence) {
    references_[static_cast<std::size_t>(reference)].evidence = evidence;
  }
  /// Of the newest reference, the lost ones included.
  [[nodiscard]] CornerTracks newestTracks() const { return tracks_.since(newest_); }

 private:
  struct Reference {
    int frame = 0;  // index of frames_
    MotionEvidence evidence;
  };

  void forgetUnusedFrames();

  OrbOptions options_;
  FeatureTracks tracks_;
  std::vector<FramePtr> frames_;       // since the oldest reference
  std::vector<Reference> references_;  // oldest first
  int newest_ = 0;                     // index of the newest reference, lost or not
};

}  // namespace dsorb::init_orb
