// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"

#include "init/orb/tracks/corner_tracks.h"

#include <cstdint>

namespace dsorb::init_orb {

/// Leaves out the tracks of what moves with the camera: a bonnet, a watermark, hot pixels. They
/// stand still in all frames though the others, all over the image, say that the camera turned;
/// points far away would move with it.
/// @param seed of the samples by which the others' motion is found
/// @return how many were left out
/// @source docs/experiments.md, "Stuck tracks"
int leaveOutStuck(CornerTracks& tracks, const PinholeCamera& camera, std::uint64_t seed);

}  // namespace dsorb::init_orb
