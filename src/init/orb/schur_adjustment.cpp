// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/adjustment_solvers.h"
#include "init/orb/damping.h"
#include "init/orb/reprojection_equations.h"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

namespace dsorb::init_orb {
namespace {

constexpr double kMinGradient = 1e-10;  // largest entry at a minimum; default of Ceres

bool isMinimum(const ReprojectionEquations& system) {
  return system.pose_gradient.lpNorm<Eigen::Infinity>() < kMinGradient &&
         system.depth_gradient.lpNorm<Eigen::Infinity>() < kMinGradient;
}

struct Step {
  Eigen::VectorXd poses;   // left increments, 6 a posed frame
  Eigen::VectorXd depths;  // one a corner
  double decrease = 0;     // of the cost that the equations predict
};

/// Solution of the equations with their diagonal scaled by 1 + damping; depths are eliminated.
std::optional<Step> solveDamped(const ReprojectionEquations& system, double damping) {
  const Eigen::VectorXd pose_diagonal = system.pose_hessian.diagonal();
  const Eigen::ArrayXd depth_hessian = (1 + damping) * system.depth_hessian.array();
  const Eigen::VectorXd inverse = (depth_hessian > 0).select(depth_hessian.inverse(), 0.0);
  const Eigen::MatrixXd root = system.coupling * inverse.cwiseSqrt().asDiagonal();
  Eigen::MatrixXd schur = system.pose_hessian;
  schur.diagonal() += damping * pose_diagonal;
  schur.selfadjointView<Eigen::Lower>().rankUpdate(root, -1.0);
  const Eigen::LLT<Eigen::MatrixXd, Eigen::Lower> cholesky(schur);
  if (cholesky.info() != Eigen::Success) {
    return std::nullopt;
  }
  Step step;
  step.poses = -cholesky.solve(system.pose_gradient -
                               system.coupling * inverse.cwiseProduct(system.depth_gradient));
  step.depths =
      -inverse.cwiseProduct(system.depth_gradient + system.coupling.transpose() * step.poses);
  step.decrease =
      0.5 *
      (step.poses.dot(damping * pose_diagonal.cwiseProduct(step.poses) - system.pose_gradient) +
       step.depths.dot(damping * system.depth_hessian.cwiseProduct(step.depths) -
                       system.depth_gradient));
  return std::isfinite(step.decrease) ? std::optional(std::move(step)) : std::nullopt;
}

/// Poses and inverse depths of a map: what a solver moves.
struct Unknowns {
  explicit Unknowns(const InitialMap& map) : T_cam_ref(map.T_cam_ref) {
    for (const Corner& corner : map.corners) inverse_depths.push_back(corner.inverse_depth);
  }
  void writeTo(InitialMap& map) const {
    map.T_cam_ref = T_cam_ref;
    for (std::size_t i = 0; i < inverse_depths.size(); ++i) {
      map.corners[i].inverse_depth = inverse_depths[i];
    }
  }
  void move(const Step& step, const PoseRows& pose_rows) {
    for (std::size_t k = 1; k < T_cam_ref.size(); ++k) {
      if (pose_rows.first[k] < 0) continue;
      const Vector6d increment = step.poses.segment<kPoseSize>(pose_rows.first[k]);
      T_cam_ref[k] = SE3::exp(increment) * *T_cam_ref[k];
    }
    for (std::size_t i = 0; i < inverse_depths.size(); ++i) {
      inverse_depths[i] += step.depths[static_cast<Eigen::Index>(i)];
    }
  }

  std::vector<std::optional<SE3>> T_cam_ref;
  std::vector<double> inverse_depths;
};

}  // namespace

std::optional<int> solveWithSchur(InitialMap& map,
                                  const std::vector<char>& kept,
                                  const PinholeCamera& camera,
                                  const GeometricOptions& options) {
  const PoseRows pose_rows(map);
  std::optional<double> cost = reprojectionCost(map, kept, camera, options);
  if (!cost || pose_rows.size == 0) {
    return std::nullopt;
  }
  Damping damping;
  ReprojectionEquations system = linearize(map, kept, pose_rows, camera, options);
  int iteration = 0;
  while (iteration < options.max_iterations && !damping.exhausted() && !isMinimum(system)) {
    ++iteration;
    const Unknowns before(map);
    const std::optional<Step> step = solveDamped(system, damping.value);
    std::optional<double> moved_cost;
    if (step) {
      Unknowns moved = before;
      moved.move(*step, pose_rows);
      moved.writeTo(map);
      moved_cost = reprojectionCost(map, kept, camera, options);
    }
    if (!moved_cost || !(*moved_cost <= *cost)) {
      before.writeTo(map);
      const bool at_minimum = step && step->decrease < options.function_tolerance * *cost;
      if (at_minimum) break;
      damping.fail();
      continue;
    }
    const double change = *cost - *moved_cost;
    damping.succeed(step->decrease > 0 ? change / step->decrease : 0);
    const bool converged = change <= options.function_tolerance * *cost;
    cost = moved_cost;
    if (converged) break;
    system = linearize(map, kept, pose_rows, camera, options);
  }
  return iteration;
}

}  // namespace dsorb::init_orb
