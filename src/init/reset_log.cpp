// SPDX-License-Identifier: BSD-3-Clause
#include "init/reset_log.h"

#include <cstddef>
#include <optional>
#include <utility>

namespace dsorb {
namespace {

constexpr std::size_t kKeptResets = 32;  // reasons kept; a camera may stand in the dark for hours

}  // namespace

InitStep needsMoreFrames(InitReason reason) {
  return {InitStatus::kNeedsMoreFrames, reason, std::nullopt};
}

void ResetLog::clear() {
  restarts_ = 0;
  latest_.clear();
}

InitStep ResetLog::restart(InitReason reason) {
  ++restarts_;
  if (latest_.size() == kKeptResets) latest_.erase(latest_.begin());
  latest_.push_back(reason);
  return {InitStatus::kRestarted, reason, std::nullopt};
}

InitStep ResetLog::finish(InitializationResult result, const StageClock& clock) const {
  InitReport& report = result.report;
  report.restarts = restarts_;
  report.earlier_resets = latest_;
  report.stages = clock.stages();
  checkInvariants(result);
  return {InitStatus::kInitialized, InitReason::kDone, std::move(result)};
}

}  // namespace dsorb
