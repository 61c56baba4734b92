// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"

#include "geometry/row_motion.h"
#include "init/orb/map/initial_map.h"

#include <vector>

namespace dsorb::init_orb {

/// Motion of every frame by the poses of the frames around it, those without a pose being posed
/// from the corners.
std::vector<RowMotion> motionsByPoses(const InitialMap& map, const PinholeCamera& camera);

/// Sets priors of the motions of all frames from the poses around them, as tightly as the poses
/// themselves show; and the motions, where there are none yet, with mean inverse depth 1. Moves the
/// corners' pixels by the motion of the reference. Nothing happens with a global shutter.
void estimateMotions(InitialMap& map, const PinholeCamera& camera);

}  // namespace dsorb::init_orb
