// SPDX-License-Identifier: BSD-3-Clause
#include "odometry/segments.h"

namespace dsorb::odometry {
namespace {

constexpr int kMaxRollbacks = 2;  // in a segment

}  // namespace

void Segments::begin(const InitializationResult& result) {
  counts_before_ = counts_;
  ++counts_.starts;
  probation_.begin(result);
}

void Segments::next() {
  ++current_;
  was_lost_on_probation_ = false;
  rollbacks_ = 0;
}

bool Segments::passes(double rms) {
  if (probation_.passes(rms)) return true;
  if (rollbacks_ < kMaxRollbacks) return false;
  probation_.end();
  return true;
}

bool Segments::canRollBack(RollbackReason reason) const {
  if (!probation_.active()) return false;
  return reason == RollbackReason::kResidual || (options_.includes_loss && !was_lost_on_probation_);
}

FailedStart Segments::rollBack(RollbackReason reason, FrameId newest) {
  const Judgement& judgement = probation_.lastJudgement();
  FailedStart start;
  start.notice = {newest, current_, reason, judgement.keyframes, judgement.rms, judgement.limit};
  start.frames = probation_.end();
  counts_ = counts_before_;
  ++rollbacks_;
  was_lost_on_probation_ |= reason == RollbackReason::kLost;
  return start;
}

}  // namespace dsorb::odometry
