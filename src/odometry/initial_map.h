// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/init/result.h"
#include "dsorb/odometry/observer.h"

#include "image/photometric.h"

#include <cstddef>
#include <vector>

namespace dsorb::odometry {

/// The points of an initialization as inverse depths in one of its frames.
/// @param target index of a posed frame
/// @return points in front of the frame, also those outside its image; weight = 1 / standard
///         deviation of the inverse depth there
std::vector<DepthSample> depthSamples(const InitializationResult& result,
                                      const PinholeCamera& camera,
                                      std::size_t target);

/// Keyframes of an initialization, in the order of their frames: the reference, every frame that
/// hosts points, and the newest one, each with the points it hosts.
std::vector<KeyframeSnapshot> initialKeyframes(const InitializationResult& result,
                                               const PinholeCamera& camera,
                                               int segment);

}  // namespace dsorb::odometry
