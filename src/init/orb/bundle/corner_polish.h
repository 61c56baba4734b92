// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/options/orb.h"

#include "init/orb/map/initial_map.h"

#include <vector>

namespace dsorb::init_orb {

struct PolishReport {
  bool accepted = false;
  bool fits = true;           ///< at least half of the corners match the images
  double first_rms = 0;       ///< of the patches' pixels before the first step [grey levels]
  double last_rms = 0;        ///< and before the last one
  double turn_deg = 0;        ///< of the newest frame's direction of translation
  int dropped = 0;            ///< corners whose patches do not match
  GeometricOptions adjusted;  ///< what the last adjustment ran with: sigma 1, own weights
};

/// Measures every corner again in every posed frame and adjusts, several times. The patch of the
/// reference is warped by pose and inverse depth, so the measurement does not drift as tracking
/// from frame to frame does, and knows its covariance. Runs in parallel inside the caller's arena.
/// @param map       adjusted; unchanged unless the polish is accepted: the pixels fit no worse than
///                  before, most corners do, and the direction of translation hardly turned
/// @param geometric of the adjustment before: sigma of the tracks
PolishReport polishCorners(InitialMap& map,
                           const PinholeCamera& camera,
                           const GeometricOptions& geometric,
                           int rounds);

/// The same measurements for single frames: their poses are fitted to them, all inverse depths and
/// all other poses stay. Sets the brightness and the covariance of the frames as well.
/// @param map       every frame posed, adjusted frames with their joint covariance; observations
///                  are left as they are
/// @param geometric of the adjustment: its robust loss and variance factor
/// @param frames    indices, none of them adjusted nor the reference
void polishPoses(InitialMap& map,
                 const PinholeCamera& camera,
                 const GeometricOptions& geometric,
                 int rounds,
                 const std::vector<int>& frames);

}  // namespace dsorb::init_orb
