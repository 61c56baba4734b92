// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/options/orb.h"

#include "init/orb/map/attempt_types.h"

#include <optional>
#include <vector>

namespace dsorb::init_orb {

/// Median angle between the rays to a corner from the reference and from the newest frame [deg].
double medianParallaxDeg(const InitialMap& map, const PinholeCamera& camera);

/// Median error of an inverse depth, relative to the larger of itself and that of the scene's near
/// part, which a quarter of the corners exceeds: a background far away need not be known as well as
/// its own distance.
double depthSigma(const std::vector<Corner>& corners);

/// How much larger the errors are than the images' noise explains: at least 1.
/// @param median_error of the corners, whitened by their covariances [-]
double misfitOf(double median_error);

/// Whether a map has enough of the reference's live tracks.
bool hasEnoughCorners(const InitialMap& map, int live_tracks);

/// What is known of a start beside its map.
struct StartEvidence {
  int live_tracks = 0;                     ///< of the reference
  double front_share = 0;                  ///< of the corners, in front of the camera
  double misfit = 1;                       ///< misfitOf the refined corners; covariances have it
  std::optional<double> plane_cost_ratio;  ///< of the other motion of a plane
};

/// Judges a start.
/// @param map refined, mean inverse depth 1, with covariances
GateReport judgeStart(const InitialMap& map,
                      const PinholeCamera& camera,
                      const GateOptions& options,
                      const StartEvidence& evidence);

/// Whether a start would pass by its errors alone if they had shrunk by a factor.
bool errorsPass(const GateReport& report, double shrunk_by, const GateOptions& options);

/// Cells of the image with corners in them.
int occupiedCells(const InitialMap& map, const PinholeCamera& camera);

/// Whether the last attempt from this reference, extrapolated by the growth of the parallax, tells
/// that the next one is refused unless the parallax is this much larger still.
bool refusedUnless(double larger,
                   const AttemptSummary& last,
                   double rotation_residual,
                   const GateOptions& gate);

/// Whether a start that passes should wait all the same: its rows move, and of a few frames their
/// motion is mostly what the frames around let expect. docs/experiments.md, "Rolling shutter"
bool isYoung(const ReferenceView& view, double direction_sigma_deg);

/// Whether enough has changed since the last attempt from this reference: the predicted errors fall
/// as the rotation-compensated flow grows.
bool worthTheTime(const ReferenceView& view, double rotation_residual, const GateOptions& gate);

}  // namespace dsorb::init_orb
