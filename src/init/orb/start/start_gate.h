// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/init/report.h"
#include "dsorb/options/orb.h"

#include "init/orb/map/initial_map.h"

namespace dsorb::init_orb {

/// Standard deviation of the direction of the newest frame's translation [rad].
struct DirectionSigma {
  double predicted;  ///< with the options' sigma
  double fitted;     ///< times the root of the a-posteriori variance factor
};

/// Predicted error of the direction of the newest frame's translation: the larger one perpendicular
/// to it, from the adjustment's normal equations. It is formal: errors that all corners share are
/// not included.
/// @source docs/experiments.md, "When to start"
/// @param map adjusted; newest frame posed
/// @return infinite when the equations are singular
DirectionSigma directionSigma(const InitialMap& map,
                              const PinholeCamera& camera,
                              const GeometricOptions& options);

/// Median angle between the rays to a corner from the reference and from the newest frame [deg].
double medianParallaxDeg(const InitialMap& map, const PinholeCamera& camera);

/// Parallax that a start needs whose direction has this predicted sigma [deg].
double neededParallaxDeg(const GateOptions& gate, double direction_sigma_deg);

/// Judges a start.
/// @param map         adjusted
/// @param live_tracks of the reference
/// @param front_share of the corners, in front of the camera
GateReport judgeStart(const InitialMap& map,
                      const PinholeCamera& camera,
                      const OrbOptions& options,
                      int live_tracks,
                      double front_share);

}  // namespace dsorb::init_orb
