// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/frame.h"
#include "dsorb/init/result.h"
#include "dsorb/options/odometry.h"

#include <cstddef>
#include <deque>

namespace dsorb::odometry {

/// An adjustment against the limit that it had to keep to.
struct Judgement {
  int keyframes = 0;  ///< since the start, which counts as two
  double rms = 0;     ///< of a pixel's residual after the adjustment [grey levels]
  double limit = 0;   ///< [grey levels]
};

/// The time after an initialization in which its map must prove itself: the adjustments of the
/// first keyframes may leave only so much residual. Keeps the frames since the reference, so that
/// they can be used again.
class Probation {
 public:
  static constexpr std::size_t kMaxFrames = 60;  ///< kept; the oldest beyond it are forgotten

  explicit Probation(const ProbationOptions& options) : options_(options) {}

  /// Begins with the frames of an initialization.
  void begin(const InitializationResult& result);
  /// Keeps a further frame while probation lasts; at most kMaxFrames.
  void add(const FramePtr& frame);
  /// Judges the next adjustment; after the last judged one probation ends. The first is that of the
  /// initialization: whatever it made keyframes, reference and newest frame count.
  /// @param rms of a pixel's residual [grey levels]
  /// @return    whether the map may stay, as it always may after probation
  [[nodiscard]] bool passes(double rms);
  /// Of this start; all zero before the first.
  [[nodiscard]] const Judgement& lastJudgement() const { return judgement_; }
  /// Ends it. @return the frames to be used again, oldest first, without the reference
  std::deque<FramePtr> end();

  [[nodiscard]] bool active() const { return !frames_.empty(); }

 private:
  void keep(const FramePtr& frame);

  ProbationOptions options_;
  std::deque<FramePtr> frames_;
  Judgement judgement_;
};

}  // namespace dsorb::odometry
