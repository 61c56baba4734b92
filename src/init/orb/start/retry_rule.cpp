// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/start/retry_rule.h"

#include "init/orb/start/start_gate.h"

#include <cstddef>

namespace dsorb::init_orb {
namespace {

/// An attempt is left out where the last one from this reference, extrapolated by the growth of the
/// parallax, misses the gate by more than this factor.
constexpr double kRetryMargin = 1.5;
constexpr int kMaxSkippedFrames = 1;       // but so many times in a row at most
constexpr std::size_t kGrownUpFrames = 8;  // of a start whose rows move; with fewer its direction
constexpr double kYoungSigmaDeg = 0.5;     // has to be as sure as this

}  // namespace

bool refusedUnless(double larger,
                   const AttemptSummary& last,
                   double rotation_residual,
                   const GateOptions& gate) {
  return last.gate &&
         !errorsPass(*last.gate, larger * rotation_residual / last.rotation_residual, gate);
}

bool isYoung(const ReferenceView& view, double direction_sigma_deg) {
  const bool rows_move = view.readout && view.readout->seconds != 0;
  return rows_move && view.frames.size() < kGrownUpFrames && direction_sigma_deg > kYoungSigmaDeg;
}

bool worthTheTime(const ReferenceView& view, double rotation_residual, const GateOptions& gate) {
  const AttemptSummary& last = view.last;
  const bool was_young = last.gate && last.reason == InitReason::kSettling;
  if (was_young) return view.frames.size() >= kGrownUpFrames;
  return last.skipped >= kMaxSkippedFrames ||
         !refusedUnless(kRetryMargin, last, rotation_residual, gate);
}

}  // namespace dsorb::init_orb
