// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/init/result.h"

#include "init/orb/map/attempt_types.h"

namespace dsorb::init_orb {

/// Tries to initialize from one reference: motion and corners (report_motion or informed_motion),
/// then semi-dense depth and what follows it.
Attempt attemptFrom(const ReferenceView& view, const AttemptContext& context);

/// The result of a successful attempt; restarts and stages are the caller's.
InitializationResult toResult(Attempt attempt);

}  // namespace dsorb::init_orb
