// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "estimate/schur_problem.h"
#include "init/orb/thesis/ceres/reprojection_cost.h"

#include <ceres/ceres.h>

#include <array>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

namespace dsorb::init_orb {

/// Unknowns as parameter blocks, which must stay where they are while a problem knows them.
struct CeresUnknowns {
  std::vector<PoseBlock> poses;
  std::vector<std::array<double, 2>> affine;  ///< empty where the brightness is known
  std::vector<double> inverse_depth;
};

/// A problem whose caller owns what it is made of.
inline ceres::Problem::Options problemOptions() {
  ceres::Problem::Options options;
  options.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  borrowManifolds(options);
  return options;
}

/// Eliminates the inverse depths; silent, and on one thread: with more the sums have no fixed
/// order.
/// @return nullopt without a usable solution
inline std::optional<ceres::Solver::Summary> solveBySchur(ceres::Problem& problem,
                                                          CeresUnknowns& unknowns,
                                                          const Stopping& stopping) {
  auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  const auto add = [&](double* block, int group) {
    if (problem.HasParameterBlock(block)) ordering->AddElementToGroup(block, group);
  };
  for (double& depth : unknowns.inverse_depth) add(&depth, 0);
  for (PoseBlock& pose : unknowns.poses) add(pose.data(), 1);
  for (auto& affine : unknowns.affine) add(affine.data(), 1);
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.linear_solver_ordering = std::move(ordering);
  options.max_num_iterations = stopping.max_iterations;
  options.function_tolerance = stopping.cost_change;
  options.num_threads = 1;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  if (!summary.IsSolutionUsable()) return std::nullopt;
  return summary;
}

}  // namespace dsorb::init_orb
