// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/init/result.h"
#include "dsorb/options/initializer.h"

#include "init/orb/map/initial_map.h"
#include "init/orb/map/reference_view.h"
#include "init/stage_clock.h"

#include <cstdint>
#include <optional>

namespace dsorb::init_orb {

/// One try to initialize: the map when it succeeded, else the reason.
struct Attempt {
  InitReason reason = InitReason::kSettling;
  std::optional<InitialMap> map;
  MotionEvidence evidence;
  InitReport report;  ///< model, parallax, inliers, residual and details; the rest is the caller's
};

/// What every stage of an attempt is given.
struct AttemptContext {
  const PinholeCamera& camera;
  const InitializerOptions& options;
  StageClock& clock;

  [[nodiscard]] std::uint64_t seed() const { return static_cast<std::uint64_t>(options.seed); }
};

}  // namespace dsorb::init_orb
