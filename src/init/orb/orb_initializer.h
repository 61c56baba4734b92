// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/init/initializer.h"

#include "base/parallel.h"
#include "image/frame_check.h"
#include "init/orb/attempt.h"
#include "init/orb/reference_pool.h"
#include "init/reset_log.h"
#include "init/stage_clock.h"

namespace dsorb::init_orb {

/// Initializer from corner tracks: motion between a reference and the newest frame, geometric
/// adjustment of the frames since the reference, semi-dense inverse depth of the reference.
/// @source Gladkova, Feature-based Initialization for Monocular Direct Visual Odometry, algorithm 1
class ORBInitializer final : public Initializer {
 public:
  ORBInitializer(const InitializerOptions& options, const PinholeCamera& camera);

  [[nodiscard]] InitStep addFrame(FramePtr frame) override;
  void reset() override;

 private:
  InitStep advance(FramePtr frame);
  /// Tries the references, oldest first, until one passes.
  Attempt attempt();
  [[nodiscard]] bool onlyRotated() const;

  void takeReference(FramePtr frame);
  InitStep waitWithNewReference(FramePtr frame, InitReason reason);
  InitStep restart(FramePtr frame, InitReason reason);
  InitStep finish(Attempt attempt);

  InitializerOptions options_;
  PinholeCamera camera_;
  TaskArena arena_;
  FrameCheck frame_check_;
  ReferencePool pool_;
  StageClock clock_;
  ResetLog resets_;
  bool spent_ = false;
};

}  // namespace dsorb::init_orb
