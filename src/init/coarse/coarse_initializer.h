// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/init/initializer.h"

#include "base/parallel.h"
#include "image/frame_check.h"
#include "init/coarse/coarse_alignment.h"
#include "init/coarse/coarse_handover.h"
#include "init/coarse/start_hypotheses.h"
#include "init/reset_log.h"
#include "init/stage_clock.h"

#include <vector>

namespace dsorb::init_coarse {

/// Direct initializer: aligns each new frame with the first one, pose, brightness and the inverse
/// depths of the first frame's points together, coarse to fine. A prior holds translation and
/// depths until the images explain a motion well enough ("snap"); after some more frames it hands
/// over.
/// @source front end of DSO as published with Engel et al., arXiv:1607.02565
class CoarseInitializer : public Initializer {
 public:
  CoarseInitializer(const InitializerOptions& options, const PinholeCamera& camera);

  [[nodiscard]] InitStep addFrame(FramePtr frame) override;
  void reset() override;

 private:
  /// Makes the frame the first one.
  /// @return false when it has too few points
  bool setReference(const FramePtr& frame);
  /// Aligns the newest frame on all levels; the report is that of the finest.
  LevelReport track(const FramePtr& frame);
  /// The estimate of the last frame, and what it becomes by the last relative motion.
  [[nodiscard]] std::vector<Alignment> startValues(const Frame& frame,
                                                   const Alignment& last,
                                                   const SE3& motion) const;
  /// The start that fits the coarsest level better.
  [[nodiscard]] Alignment bestStart(const Frame& frame, const std::vector<Alignment>& starts);
  /// Brings the prior back where a pure rotation explains the newest frame nearly as well.
  void confirmSnap();
  [[nodiscard]] bool waitsForParallax() const;
  InitStep assess(const LevelReport& finest);
  /// Lets motions in other directions compete with the estimate and takes over the best.
  /// @return margin of the contest
  double challenge(const LevelReport& finest);
  InitStep conclude(const LevelReport& finest);
  /// Drops everything before the frame. @param lost everything is wrong, not just old
  InitStep startOver(const FramePtr& frame, InitReason reason, bool lost);

  InitializerOptions options_;
  PinholeCamera camera_;
  TaskArena arena_;
  FrameCheck frame_check_;
  LevelAligner aligner_;
  RotationSearch rotation_search_;

  CoarseAttempt attempt_;
  StageClock clock_;
  int snapped_since_ = 0;    ///< frames tracked up to the one that snapped, 0: not yet
  int tracked_ = 0;          ///< frames since the reference
  int refusals_ = 0;         ///< frames in a row that settled in poor quality
  double inlier_share_ = 0;  ///< of the newest frame
  bool done_ = false;
  ResetLog resets_;
  SE3 last_motion_;  ///< from the frame before the newest to the newest
};

}  // namespace dsorb::init_coarse
