// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/init/stage_reports.h"
#include "dsorb/options/orb_mapping.h"

#include "init/orb/map/initial_map.h"

#include <Eigen/Core>

#include <optional>

namespace dsorb::init_orb {

/// Another lens than the calibrated one.
struct OtherLens {
  LensScore score;
  /// Left increments that take the joint frames' poses to where it has them, 6 rows each.
  Eigen::VectorXd moved{};
};

/// Tries four lenses beside the calibrated one: a focal length 1.6 times as short and as long, and
/// a first radial coefficient of -.15 and .15 beside the calibrated one. With each, poses and
/// inverse depths are adjusted anew. Runs in parallel inside the caller's arena.
/// @param map     adjusted, of a global shutter, with its joint frames
/// @param options of that adjustment
/// @return the one that the tracks fit best; nullopt where none can be tried
std::optional<OtherLens> profileLens(const InitialMap& map,
                                     const PinholeCamera& camera,
                                     const GeometricOptions& options);

}  // namespace dsorb::init_orb
