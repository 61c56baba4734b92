// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/init/initializer.h"
#include "dsorb/init/result.h"

#include "base/parallel.h"
#include "image/frame_check.h"
#include "init/orb/map/attempt_types.h"
#include "init/orb/reference_pool.h"
#include "init/orb/start/essential_start.h"
#include "init/reset_log.h"

#include <optional>

namespace dsorb::init_orb {

/// Tries to initialize from one reference: essential matrix, adjustment of a few frames, a gate,
/// refined corners; all other frames are posed in the end.
Attempt attemptFrom(ReferenceView seen, const AttemptContext& context);

/// Initializer from corners: motion between a reference and the newest frame, geometric adjustment
/// of the frames since the reference, semi-dense inverse depth of the reference.
/// @source [Gladkova], algorithm 1 (full reference: docs/references.md)
class ORBInitializer final : public Initializer {
 public:
  ORBInitializer(const InitializerOptions& options, const PinholeCamera& camera);

  [[nodiscard]] InitStep addFrame(FramePtr frame) override;
  void reset() override;
  void setHurried(bool hurried) override { hurried_ = hurried; }

 private:
  InitStep advance(FramePtr frame);
  /// Tries the references, oldest first, until one passes.
  Attempt tryReferences();
  [[nodiscard]] bool onlyRotated() const;

  /// Makes the frame the only reference. @return the step
  InitStep startOver(FramePtr frame, InitStep step);

  InitializerOptions options_;
  PinholeCamera camera_;
  TaskArena arena_;
  FrameCheck frame_check_;
  ReferencePool pool_;
  StageClock clock_;
  ResetLog resets_;
  bool spent_ = false;
  bool hurried_ = false;
  int blank_ = 0;    ///< frames in a row that show nothing
  int put_off_ = 0;  ///< attempts in a row, for want of time
};

}  // namespace dsorb::init_orb
