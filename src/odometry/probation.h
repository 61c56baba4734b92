// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/frame.h"
#include "dsorb/init/result.h"
#include "dsorb/odometry/observer.h"
#include "dsorb/options/odometry.h"

#include <deque>

namespace dsorb::odometry {

/// The time after an initialization in which its map must prove itself: the adjustments of the
/// first keyframes may leave only so much residual. Keeps the frames since the reference, so that
/// they can be used again.
class Probation {
 public:
  explicit Probation(const ProbationOptions& options) : options_(options) {}

  /// Begins with the frames of an initialization.
  void begin(const InitializationResult& result);
  /// A further frame; the oldest are forgotten when they become too many.
  void add(const FramePtr& frame);
  /// Judges the next adjustment; after the last judged one probation ends. The first is that of the
  /// initialization: whatever it made keyframes, reference and newest frame count.
  /// @param rms of a pixel's residual [grey levels]
  /// @return    whether the map may stay
  [[nodiscard]] bool passes(double rms);
  /// The last judgement, as observers are told of it; without frame, segment and reason.
  [[nodiscard]] const InitializationRollback& judgement() const { return judgement_; }
  /// Ends it. @return the frames to be used again, without the reference
  std::deque<FramePtr> end();

  [[nodiscard]] bool active() const { return !frames_.empty(); }

 private:
  ProbationOptions options_;
  std::deque<FramePtr> frames_;
  int keyframes_ = 0;
  InitializationRollback judgement_;
};

}  // namespace dsorb::odometry
