// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/init/report.h"

#include <chrono>
#include <string>
#include <utility>
#include <vector>

namespace dsorb {

/// Adds up the wall time of named stages, for the report; nothing ever decides by it.
class StageClock {
 public:
  template <typename Function>
  auto time(const char* stage, Function&& function) {
    const Measurement measurement(*this, stage);
    return std::forward<Function>(function)();
  }
  void clear() { stages_.clear(); }
  [[nodiscard]] const std::vector<StageTime>& stages() const { return stages_; }

 private:
  class Measurement {
   public:
    Measurement(StageClock& clock, const char* stage) : clock_(clock), stage_(stage) {}
    Measurement(const Measurement&) = delete;
    Measurement& operator=(const Measurement&) = delete;
    ~Measurement() {
      const std::chrono::duration<double, std::milli> elapsed =
          std::chrono::steady_clock::now() - start_;
      clock_.add(stage_, elapsed.count());
    }

   private:
    StageClock& clock_;
    const char* stage_;
    std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  };

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
