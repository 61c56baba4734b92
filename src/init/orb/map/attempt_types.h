// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/options/initializer.h"

#include "init/orb/map/initial_map.h"
#include "init/orb/map/outcome.h"
#include "init/orb/map/reference_view.h"
#include "init/stage_clock.h"

#include <cstdint>

namespace dsorb::init_orb {

/// Value that passes through the stages of an attempt: the map and the report so far.
struct Reconstruction {
  InitialMap map;
  InitReport report;
};

/// Context of every stage of an attempt.
struct AttemptContext {
  const PinholeCamera& camera;
  const InitializerOptions& options;
  StageClock& clock;

  [[nodiscard]] std::uint64_t seed() const { return static_cast<std::uint64_t>(options.seed); }
};

}  // namespace dsorb::init_orb
