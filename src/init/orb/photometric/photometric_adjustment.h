// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/init/report.h"
#include "dsorb/options/orb_mapping.h"

#include "init/orb/photometric/photometric_problem.h"

namespace dsorb::init_orb {

/// Poses are kept where the photometric ones contradict them: Mahalanobis distance, a degree of
/// freedom [-].
constexpr double kMaxPoseDistance = 5;

/// Adjusts inverse depths of corners and semi-dense points, the poses, and with the affine model
/// the brightness of the frames to the grey values of the images. Afterwards the mean inverse depth
/// of the adjusted points is 1. When the report is not usable the map is unchanged.
/// @param map     adjusted geometrically, with semi-dense points and brightness
/// @param problem of the map; its visibility is updated
PhotometricReport adjustPhotometry(InitialMap& map,
                                   PhotometricProblem& problem,
                                   const PinholeCamera& camera,
                                   const PhotometricOptions& options);

}  // namespace dsorb::init_orb
