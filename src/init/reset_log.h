// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/init/initializer.h"

#include "init/stage_clock.h"

#include <vector>

namespace dsorb {

/// The step of an initializer that cannot tell yet.
[[nodiscard]] InitStep needsMoreFrames(InitReason reason);

/// Remembers the resets of an initializer and makes the steps that tell of them.
class ResetLog {
 public:
  void clear();
  [[nodiscard]] InitStep restart(InitReason reason);
  /// @param result its report gets counts, resets and stages; its invariants are checked
  [[nodiscard]] InitStep finish(InitializationResult result, const StageClock& clock) const;

 private:
  int restarts_ = 0;
  std::vector<InitReason> latest_;
};

}  // namespace dsorb
