// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/odometry/observer.h"

#include "odometry/probation.h"

#include <deque>

namespace dsorb::odometry {

/// Counts over the segments of a run, without starts that were rolled back.
struct SegmentCounts {
  int starts = 0;
  int keyframes = 0;
  int tracked_frames = 0;
};

/// A start that was rolled back.
struct FailedStart {
  InitializationRollback notice;
  std::deque<FramePtr> frames;  ///< to be used again, oldest first
};

/// The segments of a run, each from its start to a loss or a restart: numbers them, counts what
/// they hold, and has each start prove itself.
class Segments {
 public:
  explicit Segments(const ProbationOptions& options) : options_(options), probation_(options) {}

  /// A start in the current segment; its probation begins.
  void begin(const InitializationResult& result);
  /// Ends the probation of the current start, which stays.
  void endProbation() { probation_.end(); }
  /// Ends the current segment.
  void next();
  [[nodiscard]] int current() const { return current_; }

  /// A frame whose pose is known, before it goes into the map.
  void keepForRollback(const FramePtr& frame) { probation_.add(frame); }
  /// Whether the map may stay as an adjustment left it: where the images are noisy no start ever
  /// fits better, and after two that were taken back the next one stays. @param rms [grey levels]
  [[nodiscard]] bool passes(double rms);
  /// Whether a failure takes the start back. It always does so on probation, but a loss only where
  /// the options say so, and once a segment: the second time it is a loss like any other.
  [[nodiscard]] bool canRollBack(RollbackReason reason) const;
  /// Takes the start back. @param newest the frame given last
  FailedStart rollBack(RollbackReason reason, FrameId newest);

  void countKeyframes(int keyframes) { counts_.keyframes += keyframes; }
  void countTrackedFrame() { ++counts_.tracked_frames; }
  [[nodiscard]] const SegmentCounts& counts() const { return counts_; }

 private:
  ProbationOptions options_;
  Probation probation_;
  int current_ = 0;
  bool was_lost_on_probation_ = false;  // in this segment
  int rollbacks_ = 0;                   // in this segment
  SegmentCounts counts_;
  SegmentCounts counts_before_;  // the newest start
};

}  // namespace dsorb::odometry
