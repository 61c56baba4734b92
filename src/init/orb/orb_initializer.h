// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/init/initializer.h"

#include "init/orb/map/attempt_types.h"
#include "init/orb/start/essential_start.h"

#include <memory>

namespace dsorb::init_orb {

/// Tries to initialize from one reference: essential matrix, adjustment of a few frames, a gate,
/// refined corners; all other frames are posed in the end.
Attempt attemptFrom(ReferenceView seen, const AttemptContext& context);

/// Initializer from corners.
[[nodiscard]] std::unique_ptr<Initializer> makeOrbInitializer(const InitializerOptions& options,
                                                              const PinholeCamera& camera);

}  // namespace dsorb::init_orb
