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

/// Moves the poses of all posed frames but the first and the inverse depths of the corners to the
/// minimum of the reprojection errors with the robust loss of the options, and touches nothing
/// else. The scale stays about where it was.
/// @param map observations sorted by corner; every corner in front of all cameras that see it
/// @return    iterations, or nullopt when no usable numbers were found
/// @source Triggs et al., Bundle Adjustment - A Modern Synthesis, section 6.1 (Schur complement);
///         Madsen, Nielsen, Tingleff, Methods for Non-Linear Least Squares Problems, algorithm 3.16
///         (damping)
std::optional<int> solveGeometry(InitialMap& map,
                                 const PinholeCamera& camera,
                                 const GeometricOptions& options,
                                 const Stopping& stopping = {});

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
