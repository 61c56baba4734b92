// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "init/orb/photometric/photometric_problem.h"

#include <optional>

namespace dsorb::init_orb {

struct PhotometricSolve {
  int iterations = 0;
  double first_cost = 0;  ///< half the sum of the weighted Huber energies [grey levels^2]
  double cost = 0;        ///< the same afterwards
};

/// Moves poses, inverse depths and, with the affine model, the brightness of all frames to the
/// minimum of the photometric errors. The scale stays about where it was.
/// @return nullopt when no usable numbers were found; the state is as before then
/// @source Triggs et al., Bundle Adjustment - A Modern Synthesis, section 6.1 (Schur complement)
std::optional<PhotometricSolve> solvePhotometricWithSchur(const PhotometricProblem& problem,
                                                          const PhotometricOptions& options,
                                                          PhotometricState& state);

/// Moves poses (and brightness, when unknown) with all inverse depths fixed.
std::optional<PhotometricSolve> alignPhotometricPoses(const PhotometricProblem& problem,
                                                      const PhotometricOptions& options,
                                                      PhotometricState& state);

/// Moves every inverse depth on its own with all poses fixed.
PhotometricSolve refinePhotometricDepths(const PhotometricProblem& problem,
                                         int iterations,
                                         PhotometricState& state);

}  // namespace dsorb::init_orb
