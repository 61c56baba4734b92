// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"

#include "features/corner_tracks.h"

#include <Eigen/Core>

#include <cstdint>
#include <vector>

namespace dsorb {

/// Leaves out the tracks of what moves with the camera: a bonnet, a watermark, hot pixels. They
/// stand still in all frames, against the epipolar geometry of the others all over the image:
/// points far away, or those that the camera turns around, agree with it.
/// @param seed of the samples by which the others' motion is found
/// @return where the reference shows those that were left out [px]
std::vector<Eigen::Vector2f> leaveOutStuck(CornerTracks& tracks,
                                           const PinholeCamera& camera,
                                           std::uint64_t seed);

}  // namespace dsorb
