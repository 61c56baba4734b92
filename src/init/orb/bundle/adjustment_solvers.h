// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/options/orb_mapping.h"

#include "init/orb/map/initial_map.h"

#include <optional>
#include <vector>

namespace dsorb::init_orb {

/// Both solvers move the poses of all posed frames but the first and the inverse depths of the kept
/// corners of `map` to the minimum of the reprojection errors with the robust loss of the options,
/// and touch nothing else. The scale stays about where it was.
/// @param map  observations sorted by corner; every kept corner in front of all cameras that see it
/// @param kept one a corner
/// @return     iterations, or nullopt when no usable numbers were found
std::optional<int> solveWithCeres(InitialMap& map,
                                  const std::vector<char>& kept,
                                  const PinholeCamera& camera,
                                  const GeometricOptions& options);

/// @source Triggs et al., Bundle Adjustment - A Modern Synthesis, section 6.1 (Schur complement);
///         Madsen, Nielsen, Tingleff, Methods for Non-Linear Least Squares Problems, algorithm 3.16
///         (damping)
std::optional<int> solveWithSchur(InitialMap& map,
                                  const std::vector<char>& kept,
                                  const PinholeCamera& camera,
                                  const GeometricOptions& options);

/// The solver that the options name.
inline std::optional<int> solveGeometry(InitialMap& map,
                                        const std::vector<char>& kept,
                                        const PinholeCamera& camera,
                                        const GeometricOptions& options) {
  return options.solver == AdjustmentSolver::kCeres ? solveWithCeres(map, kept, camera, options)
                                                    : solveWithSchur(map, kept, camera, options);
}

}  // namespace dsorb::init_orb
