// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/init/result.h"
#include "dsorb/options/orb.h"

#include "init/orb/map/initial_map.h"

namespace dsorb::init_orb {

/// What is known of a start, and whether it is enough.
struct GateReport {
  InitReason reason = InitReason::kDone;  ///< kDone: passed
  double direction_sigma_deg = 0;  ///< predicted, of the newest frame's direction of translation,
                                   ///< times sqrt(corners / 100): as if 100 had been seen; the
                                   ///< assumed error of a track shrinks with images below 640x480
  double fitted_sigma_deg = 0;     ///< the same from the residuals as they are, all corners counted
  double parallax_deg = 0;         ///< median angle under which both cameras see a corner
};

/// Standard deviation of the direction of the newest frame's translation [rad].
struct DirectionSigma {
  double predicted;  ///< with the options' sigma
  double fitted;     ///< times the root of the a-posteriori variance factor
};

/// Predicted error of the direction of the newest frame's translation: the larger one perpendicular
/// to it, from the adjustment's normal equations. Formal: errors that all corners share are not in
/// it.
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
