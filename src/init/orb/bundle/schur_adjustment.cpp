// SPDX-License-Identifier: BSD-3-Clause
#include "estimate/levenberg_marquardt.h"
#include "estimate/schur_problem.h"
#include "init/orb/bundle/adjustment_solvers.h"
#include "init/orb/bundle/reprojection_equations.h"

#include <cmath>
#include <cstddef>

namespace dsorb::init_orb {
namespace {

/// Linearization and update of the state.
struct Model {
  const ReprojectionProblem& problem;

  void linearize(const ReprojectionState& state, ReprojectionEquations& equations) const {
    problem.linearize(state, equations);
  }
  static void move(const ReprojectionState& from,
                   const DampedSolver<double>& solution,
                   ReprojectionState& to) {
    for (std::size_t f = 0; f < from.T_cam_ref.size(); ++f) {
      const auto at = static_cast<Eigen::Index>(f) * kPoseSize;
      to.T_cam_ref[f] = SE3::exp(solution.step().segment<kPoseSize>(at)) * from.T_cam_ref[f];
    }
    for (std::size_t i = 0; i < from.inverse_depth.size(); ++i) {
      to.inverse_depth[i] = from.inverse_depth[i] + solution.depthStep()[i];
    }
  }
};

}  // namespace

std::optional<int> solveWithSchur(InitialMap& map,
                                  const std::vector<char>& kept,
                                  const PinholeCamera& camera,
                                  const GeometricOptions& options) {
  const PoseRows pose_rows(map);
  if (pose_rows.size == 0) return std::nullopt;
  const ReprojectionProblem problem(map, kept, pose_rows, camera, options);
  SchurProblem<Model, ReprojectionState, ReprojectionEquations> adjustment(
      {problem}, ReprojectionState(map, pose_rows), options.function_tolerance);
  if (!std::isfinite(adjustment.cost())) return std::nullopt;
  GainDamping damping;
  const int iterations =
      adjustment.atMinimum() ? 0 : minimize(adjustment, damping, options.max_iterations);
  adjustment.state().writeTo(map, pose_rows);
  return iterations;
}

}  // namespace dsorb::init_orb
