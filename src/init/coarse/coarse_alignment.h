// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/options/coarse.h"

#include "init/coarse/coarse_points.h"
#include "init/coarse/coarse_residual.h"

namespace dsorb::init_coarse {

/// What an alignment may change.
enum class Unknowns {
  kAll,      ///< pose, brightness and inverse depths, with the prior and the coupling
  kPose,     ///< pose and brightness
  kRotation  ///< rotation and brightness
};

/// Prior toward no translation and inverse depth 1, over all n points of a level.
/// @source E = w n |t|^2 [+ w sum (depth - 1)^2], at most c n; front end of DSO as published, which
///         has the bracket in the gradient and not in the energy
struct StationaryUnitPlanePrior {
  double energy = 0;
  double weight = 0;  ///< w while below the cap, else 0
  bool capped = false;
};

/// One state: photometric and prior terms together.
struct LevelState {
  LevelSums sums;
  StationaryUnitPlanePrior prior;
  [[nodiscard]] double energy() const { return sums.energy + prior.energy; }
};

/// How one level went.
struct LevelReport {
  int iterations = 0;  ///< steps tried
  LevelState state;    ///< at the accepted estimate
  int points = 0;
  [[nodiscard]] double inlierShare() const;   ///< of the good points
  [[nodiscard]] double visibleShare() const;  ///< good points, of all
};

/// Levenberg-Marquardt on one level: pose and brightness with the inverse depths eliminated (Schur
/// complement). Keeps its buffers, so steady work does not allocate.
/// @source front end of DSO as published; eliminated depths as in Engel et al., arXiv:1607.02565,
///         section 2.3
class LevelAligner {
 public:
  explicit LevelAligner(const CoarseOptions& options) : options_(options) {}

  /// @param max_iterations steps tried are one more at most
  /// @param points         trial inverse depths start from the accepted ones
  /// @param alignment      start value and result
  LevelReport align(const LevelView& view,
                    int max_iterations,
                    Unknowns unknowns,
                    PointLevel& points,
                    Alignment& alignment);

  /// Equations at an estimate, at the points' trial inverse depths.
  LevelState evaluate(const LevelView& view,
                      Unknowns unknowns,
                      PointLevel& points,
                      const Alignment& alignment);

  /// Damped step of pose and brightness from the accepted equations.
  /// @return increment, [translation; rotation; log gain; offset], 0 where nothing may change
  [[nodiscard]] Vector8d solve(Unknowns unknowns, double damping);

  /// Sets the trial inverse depths that belong to a step of solve().
  void stepDepths(const Vector8d& step, PointLevel& points);

  /// Equations of the last evaluation, prior included.
  [[nodiscard]] const LinearSystem<float>& evaluated() const { return trial_; }

  /// Makes the last evaluation the accepted one.
  void accept(PointLevel& points);

 private:
  class Problem;

  [[nodiscard]] StationaryUnitPlanePrior stationaryUnitPlanePrior(const PointLevel& points,
                                                                  const Alignment& alignment) const;
  /// Difference of the coupling energies, trial less accepted.
  [[nodiscard]] double couplingGain(const PointLevel& points,
                                    const LevelState& accepted,
                                    const LevelState& trial,
                                    bool snapped) const;

  CoarseOptions options_;
  LinearSystem<float> accepted_;
  LinearSystem<float> trial_;
  DepthElimination<float> elimination_;
  std::vector<double> depth_step_;
};

/// Smooths the inverse depths of a level, or, before the translation has left the prior, sets the
/// smoothed ones to 1.
void regularize(bool snapped, PointLevel& points);

}  // namespace dsorb::init_coarse
