// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/init/result.h"

#include "init/orb/map/attempt_types.h"

namespace dsorb::init_orb {

/// One try to initialize.
struct Attempt {
  Outcome<Reconstruction> made = InitReason::kSettling;
  AttemptSummary summary;
};

/// Tries to initialize from one reference.
Attempt attemptFrom(const ReferenceView& view, const AttemptContext& context);

/// The hand-over of a successful attempt, in the common unit; points at or behind infinity are left
/// out. Counts, restarts and stages of the report are the caller's.
InitializationResult toResult(Reconstruction made);

}  // namespace dsorb::init_orb
