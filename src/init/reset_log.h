// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/init/initializer.h"
#include "dsorb/init/report.h"

#include "base/timed.h"

#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

namespace dsorb {

/// Adds up the wall time of named stages, for the report; nothing ever decides by it.
class StageClock {
 public:
  template <typename Function>
  decltype(auto) time(const char* stage, Function&& function) {
    double seconds = 0;
    struct Note {
      ~Note() { clock.add(stage, 1e3 * seconds); }
      StageClock& clock;
      const char* stage;
      const double& seconds;
    };
    const Note note{*this, stage, seconds};
    return timed(seconds, std::forward<Function>(function));
  }
  void clear() { stages_.clear(); }
  [[nodiscard]] const std::vector<StageTime>& stages() const { return stages_; }

 private:
  void add(const char* stage, double milliseconds) {
    for (StageTime& known : stages_) {
      if (known.stage == stage) {
        known.milliseconds += milliseconds;
        return;
      }
    }
    stages_.push_back({stage, milliseconds});
  }

  std::vector<StageTime> stages_;
};

/// The step of an initializer that cannot tell yet.
[[nodiscard]] inline InitStep needsMoreFrames(InitReason reason) {
  return {InitStatus::kNeedsMoreFrames, reason, std::nullopt};
}

/// Remembers the resets of an initializer and makes the steps that tell of them.
class ResetLog {
 public:
  void clear() {
    restarts_ = 0;
    latest_.clear();
  }
  [[nodiscard]] InitStep restart(InitReason reason) {
    ++restarts_;
    if (latest_.size() == kKept) latest_.erase(latest_.begin());
    latest_.push_back(reason);
    return {InitStatus::kRestarted, reason, std::nullopt};
  }
  /// @param result its report gets counts, resets and stages; its invariants are checked
  [[nodiscard]] InitStep finish(InitializationResult result, const StageClock& clock) const {
    InitReport& report = result.report;
    report.restarts = restarts_;
    report.earlier_resets = latest_;
    report.stages = clock.stages();
    checkInvariants(result);
    return {InitStatus::kInitialized, InitReason::kDone, std::move(result)};
  }

 private:
  static constexpr std::size_t kKept = 32;  // reasons; a camera may stand in the dark for hours

  int restarts_ = 0;
  std::vector<InitReason> latest_;
};

}  // namespace dsorb
