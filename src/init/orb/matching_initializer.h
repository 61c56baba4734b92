// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/init/initializer.h"

#include "base/parallel.h"
#include "image/frame_check.h"
#include "init/orb/attempt.h"
#include "init/orb/correspondences.h"
#include "init/reset_log.h"
#include "init/stage_clock.h"

namespace dsorb::init_orb {

/// Initializer from pairs of frames: ORB features matched by their descriptors (or optical flow),
/// the two-view model with the most inliers, depth along epipolar lines. While there is too little
/// parallax the pair grows; a pair that fails otherwise is given up with everything since its
/// reference.
/// @source the variant of X. Qu in Gladkova, Feature-based Initialization for Monocular Direct
///         Visual Odometry, section 4
class MatchingInitializer final : public Initializer {
 public:
  MatchingInitializer(const InitializerOptions& options, const PinholeCamera& camera);

  [[nodiscard]] InitStep addFrame(FramePtr frame) override;
  void reset() override;

 private:
  InitStep advance(FramePtr frame);
  [[nodiscard]] bool onlyRotated() const;
  InitStep finish(Attempt attempt);
  InitStep waitWithNewReference(FramePtr frame, InitReason reason);
  InitStep restart(FramePtr frame, InitReason reason);

  InitializerOptions options_;
  PinholeCamera camera_;
  TaskArena arena_;
  FrameCheck frame_check_;
  Correspondences pair_;
  StageClock clock_;
  ResetLog resets_;
  bool spent_ = false;
};

}  // namespace dsorb::init_orb
