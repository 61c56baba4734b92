// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/init/report.h"

#include "published/map.h"

#include <cstdint>

namespace dsorb::published {

/// Depths of gradient pixels beside the corners.
struct SemiDenseReport {
  int candidates = 0;  ///< selected gradient pixels
  int points = 0;      ///< candidates that were found consistently
};

/// Sets the frames' brightness and the map's points after the corners: selects gradient pixels of
/// the reference, searches each along its epipolar line in every later frame by the sum of squared
/// differences over a patch, and fuses what is found to one inverse depth with variance. Runs in
/// parallel inside the caller's arena; the result does not depend on the number of threads.
/// @param map adjusted: poses, covariances, corners with variances; mean inverse depth 1
/// @param seed of the random choice among too many candidates
/// @source [Gladkova], section 3.3
SemiDenseReport populateStructure3D(Map& map, const PinholeCamera& camera, std::uint64_t seed);

}  // namespace dsorb::published
