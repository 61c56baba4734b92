// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ceres/ceres.h>

#include <memory>
#include <optional>
#include <utility>

namespace dsorb::init_orb {

/// Eliminates the first group of the ordering; silent, and on one thread: with more the sums have
/// no fixed order.
/// @return nullopt without a usable solution
inline std::optional<ceres::Solver::Summary> solveBySchur(
    ceres::Problem& problem,
    std::shared_ptr<ceres::ParameterBlockOrdering> ordering,
    int max_iterations,
    double function_tolerance) {
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.linear_solver_ordering = std::move(ordering);
  options.max_num_iterations = max_iterations;
  options.function_tolerance = function_tolerance;
  options.num_threads = 1;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  if (!summary.IsSolutionUsable()) return std::nullopt;
  return summary;
}

}  // namespace dsorb::init_orb
