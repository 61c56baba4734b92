// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/odometry/observer.h"

#include <filesystem>
#include <vector>

namespace dsorb::io {

/// tracks.ply: corners that several keyframes see, as a binary little-endian PLY file with two
/// elements: `point` (x y z segment) and `observation` (point keyframe u v), the latter with the
/// position of the point in the former and of the keyframe's image in its sequence.
void writeTracks(const std::filesystem::path& path, const std::vector<MapTrack>& tracks);

}  // namespace dsorb::io
