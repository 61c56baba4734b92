// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "estimate/linear_system.h"
#include "window/pair_equations.h"
#include "window/pair_geometry.h"
#include "window/photometric_residual.h"
#include "window/velocity_equations.h"
#include "window/window.h"

#include <Eigen/Core>

#include <cstddef>
#include <cstdint>
#include <vector>

namespace dsorb::window {

/// A point by its place in the window.
struct PointRef {
  std::uint32_t keyframe = 0;
  std::uint32_t point = 0;
};

/// All points of a window, host by host.
[[nodiscard]] std::vector<PointRef> allPoints(const Window& window);

struct LinearizeOptions {
  EstimatedCamera camera{};         ///< estimated, too
  bool frozen = false;              ///< residuals extrapolated to the first estimates (marginals)
  bool depth_prior_pulls = true;    ///< false: the depth prior only adds curvature
  double depth_prior_factor = 1;    ///< on every depth prior
  std::size_t chunks_per_task = 0;  ///< of 128 points; 0 runs serially
};

/// Gauss-Newton system of a window: camera and frames in scaled units, and inverse depths;
/// without the priors of camera and frames.
struct WindowEquations : LinearSystem<float> {
  double energy = 0;  ///< residuals, limited by their thresholds
  double depth_prior_energy = 0;
  int used = 0;  ///< residuals in the system
};

/// Sums in double precision: what the inverse depths leave of gauge directions is a small
/// difference.
using WindowElimination = DepthElimination<float, double>;

/// Points of one host that are summed one after the other.
struct Chunk {
  std::size_t host = 0;
  std::size_t begin = 0;
  std::size_t end = 0;
  double energy = 0;
  double depth_prior_energy = 0;
  int used = 0;
};

/// Evaluates residuals and builds the system in one pass; owns the buffers it reuses. The result
/// has the same bits for any number of threads.
class NormalEquationsBuilder {
 public:
  /// Writes the trial values of all observations of the points and the system.
  /// @param points  sorted by keyframe
  void build(Window& window,
             const PairTable& pairs,
             const std::vector<PointRef>& points,
             const LinearizeOptions& options,
             WindowEquations& out);

 private:
  void split(const std::vector<PointRef>& points);
  void stitch(const Window& window, const PairTable& pairs, WindowEquations& out) const;

  std::vector<Chunk> chunks_;
  std::vector<PairSums> pair_sums_;          // chunk by target
  std::vector<VelocitySums> velocity_sums_;  // the same; rolling shutter only
};

/// Evaluates the residuals to the keyframes from a position on and sets what their outlier
/// thresholds rest on: trial states, kIn or kOutOfBounds, and raw energies.
/// @param points          sorted by keyframe
/// @param chunks_per_task of 128 points; 0 runs serially
void evaluateFrom(std::size_t first_target,
                  Window& window,
                  const PairTable& pairs,
                  const std::vector<PointRef>& points,
                  std::size_t chunks_per_task);

}  // namespace dsorb::window
