// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/options/orb.h"

#include "init/orb/bundle/reprojection_equations.h"
#include "init/orb/map/initial_map.h"

#include <optional>
#include <vector>

namespace dsorb::init_orb {

constexpr double kSevereLimit = 8;  ///< of an error; corners above it go at once [px]
constexpr double kNormalLimit = 3;  ///< least limit once the severe errors are gone [px]

/// Adjusts poses and corners in two rounds, each followed by the removal of corners whose largest
/// error is above a multiple of the robust standard deviation. Corners behind the camera stay,
/// because they are evidence against the motion.
/// @return the adjusted map; nothing where no usable numbers or too few corners were left
std::optional<InitialMap> adjustRobustly(InitialMap map,
                                         const PinholeCamera& camera,
                                         const GeometricOptions& options);

/// Measures the noise of the corners from their residuals and adjusts with it, several times.
/// @return the options with the measured sigma
GeometricOptions adjustToNoise(InitialMap& map,
                               const PinholeCamera& camera,
                               const GeometricOptions& options,
                               int rounds);

/// Adjusts once, without the corners behind a camera.
/// @return the adjusted map; nothing where no usable numbers were found
std::optional<InitialMap> adjustOnce(InitialMap map,
                                     const PinholeCamera& camera,
                                     const GeometricOptions& options,
                                     const Stopping& stopping = {});

/// Median of the reprojection errors of all observations in posed frames, whitened but for sigma.
double medianError(const InitialMap& map, const PinholeCamera& camera);

/// How much heavier the tails of the errors are than noise's: of the whitened errors across the
/// epipolar line, which no inverse depth absorbs, the square of the 90th percentile over the
/// median, over that of a normal distribution, less 1 [-]; at least 0.
double tailExcess(const InitialMap& map, const PinholeCamera& camera);

/// Flips the sign of translations and inverse depths when most corners are behind the camera, which
/// changes no projection. @return share of the corners in front of the camera
double flipToPositiveDepth(InitialMap& map);

}  // namespace dsorb::init_orb
