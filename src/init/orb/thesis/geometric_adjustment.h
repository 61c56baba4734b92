// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/options/orb_mapping.h"

#include "init/orb/map/initial_map.h"

namespace dsorb::init_orb {

struct GeometricReport {
  bool usable = false;         ///< enough corners left, all numbers finite
  int rounds = 0;              ///< solves
  int iterations = 0;          ///< of all solves
  int removed_severe = 0;      ///< corners: far off or behind a camera
  int removed_normal = 0;      ///< corners above the normal limit
  int removed_unseen = 0;      ///< corners without an observation in a posed frame
  double residual_rms = 0;     ///< of one coordinate, corners that stayed [px]
  double variance_factor = 1;  ///< a-posteriori: weighted squared error per degree of freedom [-]
};

/// A map after adjustGeometry(); half adjusted where the report is not usable.
struct GeometricAdjustment {
  InitialMap map;
  GeometricReport report{};
};

/// Adjusts the poses of all posed frames but the first and the inverse depths of all corners to the
/// observed corners, and removes outliers. Afterwards the mean inverse depth of the corners is 1;
/// corners and observations are compacted; the covariances of posed frames and the corners'
/// variances are those of the gauge "reference pose and mean inverse depth fixed", scaled by the
/// a-posteriori variance factor.
/// @param map at least one posed frame after the reference; corners with inverse depths to start
/// from
/// @source Triggs et al., Bundle Adjustment - A Modern Synthesis, sections 6.1 (Schur complement)
///         and 9 (gauge)
GeometricAdjustment adjustGeometry(InitialMap map,
                                   const PinholeCamera& camera,
                                   const GeometricOptions& options);

}  // namespace dsorb::init_orb
