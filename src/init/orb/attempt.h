// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/init/initializer.h"
#include "dsorb/init/result.h"

#include "init/orb/map/attempt_types.h"

namespace dsorb::init_orb {

/// One try to initialize.
struct Attempt {
  Outcome<Reconstruction> made = InitReason::kSettling;
  AttemptSummary summary;
  std::optional<WaitingMotion> motion{};  ///< where there is no start, but a motion
};

/// Tries to initialize from one reference.
Attempt attemptFrom(const ReferenceView& view, const AttemptContext& context);

/// Converts a successful attempt into the hand-over, in the common unit, without points at or
/// behind infinity. The caller fills in counts, restarts and stages of the report.
InitializationResult toResult(Reconstruction made);

}  // namespace dsorb::init_orb
