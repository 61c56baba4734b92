// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/geometry/se3.h"
#include "dsorb/image/affine_brightness.h"
#include "dsorb/options/brightness.h"

#include "track/alignment_kernels.h"
#include "track/tracking_reference.h"
#include "track/velocity_term.h"

#include <Eigen/Core>

#include <cstddef>
#include <limits>
#include <vector>

namespace dsorb::track {

using Vector8d = Eigen::Matrix<double, 8, 1>;
using Matrix8d = Eigen::Matrix<double, 8, 8>;
using Vector14d = Eigen::Matrix<double, kRollingParameters, 1>;

/// State that alignment estimates. Increments are [translation; rotation] from the left, then a, b,
/// then the velocity.
struct AlignmentState {
  SE3 T_cur_ref;
  AffineBrightness affine;  ///< of the frame
  RowMotion motion{};       ///< while the rows of a rolling shutter are read

  [[nodiscard]] AlignmentState plus(const Vector14d& increment) const {
    return {SE3::exp(increment.head<6>()) * T_cur_ref,
            {affine.a + increment[6], affine.b + increment[7]},
            {motion.velocity + increment.tail<6>(), motion.acceleration}};
  }
};

/// One pyramid level of a frame and of the reference it is aligned to.
struct AlignmentLevel {
  const TrackingReference& reference;
  const Frame& frame;
  int level = 0;
  /// Grey level at which the frame is clipped; infinite where it is not.
  float ceiling = std::numeric_limits<float>::infinity();
  const RowsOfFrame* rows = nullptr;  ///< of a rolling shutter
};

/// Energy of one state.
struct Evaluation {
  double energy = 0;  ///< sum of Huber energies [grey levels^2]
  int used = 0;       ///< points inside the frame, saturated ones included
  int saturated = 0;

  /// @param prior energy beside that of the points
  [[nodiscard]] double meanEnergy(double prior = 0) const {
    return used > 0 ? (energy + prior) / used : std::numeric_limits<double>::quiet_NaN();
  }
  [[nodiscard]] double saturatedFraction() const {
    return used > 0 ? static_cast<double>(saturated) / used : 0.0;
  }
};

/// Gauss-Newton system of one state: H = sum w J J^T, b = sum w J r.
template <int kParameters>
struct AlignmentEquations {
  using Matrix = Eigen::Matrix<double, kParameters, kParameters>;
  using Vector = Eigen::Matrix<double, kParameters, 1>;

  Matrix H = Matrix::Zero();
  Vector b = Vector::Zero();
};
using PoseEquations = AlignmentEquations<kAlignmentParameters>;
using RollingEquations = AlignmentEquations<kRollingParameters>;

struct LevelResult {
  double rmse = 0;             ///< sqrt(E / n) [grey levels]; NaN when no point is inside the frame
  double noise = 0;            ///< the same as the median tells it: without the errors of the map
  double inside_fraction = 0;  ///< points inside the frame, of all points of the level
  int iterations = 0;
  bool cutoff_raised = false;
  PoseEquations equations;  ///< of the state found
};

/// Direct alignment of one pyramid level: residuals, normal equations and the damped iteration.
/// Owns buffers that are used again from call to call. The bits of the result do not depend on the
/// number of threads.
class PoseAlignment {
 public:
  explicit PoseAlignment(BrightnessModel brightness = {}) : brightness_(brightness) {}

  /// @param cutoff larger residuals are saturated [grey levels]
  Evaluation evaluate(const AlignmentLevel& level, const AlignmentState& state, double cutoff);

  /// Normal equations of the last state evaluated.
  [[nodiscard]] PoseEquations normalEquations();

  /// Levenberg-Marquardt from `state`, which is left at the lowest energy found.
  LevelResult align(const AlignmentLevel& level, int max_iterations, AlignmentState& state);

  /// Equations of the last state evaluated, which was that of a rolling shutter; without the prior.
  [[nodiscard]] RollingEquations rollingEquations();

  /// Standard deviation of the residuals inside the frame, from their median; of the last state
  /// evaluated [grey levels].
  [[nodiscard]] double noise();

 private:
  class Problem;
  struct Samples {
    std::vector<float> u, v, rho, dx, dy, residual, weight, time;
  };

  template <int kParameters>
  [[nodiscard]] AlignmentEquations<kParameters> sumBlocks();
  void resize(std::size_t points);
  [[nodiscard]] SampleArrays samplesFrom(std::size_t first);
  [[nodiscard]] Evaluation evaluateRaisingCutoff(const AlignmentLevel& level,
                                                 const AlignmentState& state,
                                                 double& cutoff);

  BrightnessModel brightness_;
  AlignmentSetting setting_{};
  const ReferencePoints* points_ = nullptr;  // of the last evaluation
  Samples samples_;
  std::vector<BlockEnergy> block_energies_;
  std::vector<float> block_sums_;  // kAlignmentSums or kRollingSums a block
  std::vector<float> deviations_;  // of residuals [grey levels]
};

}  // namespace dsorb::track
