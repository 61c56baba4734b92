// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/init/report.h"

#include "base/timed.h"

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

}  // namespace dsorb
