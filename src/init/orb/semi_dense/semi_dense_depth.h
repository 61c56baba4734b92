// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/init/report.h"
#include "dsorb/options/orb_mapping.h"

#include "init/orb/map/initial_map.h"

#include <cstdint>

namespace dsorb::init_orb {

/// Sets the frames' brightness and `map.points`: selects gradient pixels of the reference, searches
/// each along its epipolar line in every later posed frame and fuses what is found to one inverse
/// depth with variance. Runs in parallel inside the caller's arena; the result does not depend on
/// the number of threads.
/// @param map adjusted: poses, covariances, corners with variances; mean inverse depth 1
/// @param seed of the random choice among too many candidates
/// @source Engel, Sturm, Cremers, Semi-Dense Visual Odometry for a Monocular Camera, ICCV 2013
SemiDenseReport estimateSemiDenseDepth(InitialMap& map,
                                       const PinholeCamera& camera,
                                       const SemiDenseOptions& options,
                                       std::uint64_t seed);

/// Keeps the points of smallest relative variance, so that corners and points are no more than
/// wanted. @return number of points removed
int keepBestPoints(InitialMap& map, int wanted);

}  // namespace dsorb::init_orb
