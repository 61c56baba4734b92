// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/frame.h"
#include "dsorb/init/report.h"

#include "features/corner_tracks.h"
#include "init/orb/map/attempt_types.h"

#include <optional>
#include <vector>

namespace dsorb::init_orb {

/// Source of the frames that an initializer may start from, with the tracks of their corners.
class ReferenceSource {
 public:
  virtual ~ReferenceSource() = default;

  /// Forgets everything; the frame becomes the only reference.
  virtual void start(FramePtr frame) = 0;
  /// Finds the corners of all references in the next frame.
  virtual void advance(FramePtr frame) = 0;
  /// Makes the newest frame another reference when one is due.
  virtual void addWhenDue() {}
  virtual void clear() = 0;

  [[nodiscard]] virtual bool empty() const = 0;
  /// The frame given last; there is one unless empty().
  [[nodiscard]] virtual const Frame& newest() const = 0;
  /// Whether the first reference has too few corners to follow.
  [[nodiscard]] virtual bool tooFewCorners() const = 0;
  /// Drops references with too few live tracks, and all at a scene cut.
  /// @return whether none is left
  virtual bool dropLost() = 0;
  /// Drops references that are given up after an attempt.
  /// @param failure of the attempt from the oldest one
  /// @return        the reason when none is left
  virtual std::optional<InitReason> giveUp(InitReason failure) = 0;

  [[nodiscard]] virtual int references() const = 0;
  /// Frames since a reference, both counted. @param reference oldest first
  [[nodiscard]] virtual int age(int reference) const = 0;
  [[nodiscard]] virtual ReferenceView view(int reference) const = 0;
  /// Whether a reference may start with fewer than OrbOptions::min_frames: the caller knows depths
  /// of it, and a later frame is there.
  [[nodiscard]] virtual bool mayStartEarly(int /*reference*/) const { return false; }
  /// References in the order in which a frame tries them.
  [[nodiscard]] virtual std::vector<int> turns() const { return {0}; }
  virtual void remember(int /*reference*/, const AttemptSummary& /*attempt*/) {}
  /// Tracks of the newest reference, lost or not; empty after a scene cut.
  [[nodiscard]] virtual CornerTracks newestTracks() const = 0;
};

}  // namespace dsorb::init_orb
