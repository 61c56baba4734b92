// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/options/orb_mapping.h"

#include "init/orb/map/initial_map.h"

#include <functional>

namespace dsorb::init_orb {

/// Options for the adjustment of refined corners: sigma 1, because each observation is whitened by
/// its own covariance, and a redescending loss.
GeometricOptions refinedAdjustment(const GeometricOptions& geometric);

/// Corners measured again by aligning warped patches.
struct RefinementReport {
  bool accepted = false;  ///< the refined corners were taken
  bool fits = true;       ///< at least half of the corners match the images
  double first_rms = 0;   ///< error of the patches' pixels before the first step [grey levels]
  double last_rms = 0;    ///< error of the patches' pixels before the last step [grey levels]
  double direction_change_deg = 0;  ///< change of the direction of the newest translation [deg]
};

/// Measures every corner again in every posed frame and adjusts, several times. The patch of the
/// reference is warped by pose and inverse depth, so the measurement does not drift as tracking
/// from frame to frame does, and knows its covariance. Runs in parallel inside the caller's arena.
/// @param map       adjusted; unchanged unless the refinement is accepted: the pixels fit no worse
///                  than before, most corners do, and the direction of translation hardly changed
/// @param geometric of the adjustment before: sigma of the tracks
/// @param hopeless  asked after the first round, which nearly reaches what the others do: whether
///                  they would be in vain; they are left out then
RefinementReport refineCorners(InitialMap& map,
                               const PinholeCamera& camera,
                               const GeometricOptions& geometric,
                               const std::function<bool(const InitialMap&)>& hopeless = {});

}  // namespace dsorb::init_orb
