// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/options/window.h"

#include "window/normal_equations.h"
#include "window/window.h"
#include "window/window_step.h"

namespace dsorb::window {

/// What an adjustment did.
struct OptimizationReport {
  bool finite = true;  ///< false: the energy is no number; the window is as before the last step
  bool converged = false;
  int iterations = 0;       ///< steps tried
  int undone_steps = 0;     ///< they raised the energy
  int residuals = 0;        ///< used in the last system
  double first_energy = 0;  ///< total, priors included
  double last_energy = 0;   ///< before a last step that was taken unseen
  double rms = 0;           ///< of a used residual's pixel [grey levels]
  WindowUncertainty uncertainty;
};

/// Adapts the outlier thresholds of the keyframes from a position on to the residuals to them.
/// @source DSO as published: the mean of a constant and 1.5 times the root of the 70 % quantile
void adaptThresholds(std::size_t first, Window& window);

/// Windowed photometric bundle adjustment: poses, brightness, inverse depths and, as an option,
/// intrinsics; the readout of a rolling shutter where it is not known. Damped Gauss-Newton with
/// first-estimate Jacobians; a step that raises the energy is undone, one that can hardly lower it
/// is taken unseen and is the last. Afterwards the newest keyframe's estimate becomes its first
/// estimate and residuals that were not used are gone.
/// @source Engel et al., DSO, arXiv:1607.02565, section 2.3
class WindowOptimizer {
 public:
  explicit WindowOptimizer(const WindowOptions& options);

  /// @throws std::logic_error with fewer than two keyframes
  OptimizationReport optimize(Window& window);
  /// The same without a step, all thresholds adapted: says how well a window that was seeded fits
  /// its images and how sure it is.
  /// @throws std::logic_error with fewer than two keyframes
  OptimizationReport assess(Window& window);

 private:
  class Adjustment;
  OptimizationReport run(Window& window, int max_iterations);

  WindowOptions options_;
  LinearizeOptions linearize_;
  // Memory kept from one adjustment to the next.
  NormalEquationsBuilder builder_;
  WindowElimination elimination_;
  WindowEquations current_;
  WindowEquations trial_;
};

}  // namespace dsorb::window
