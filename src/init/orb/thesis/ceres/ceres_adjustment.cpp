// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/bundle/robust_adjustment.h"
#include "init/orb/thesis/ceres/ceres_solve.h"

#include <ceres/loss_function.h>
#include <ceres/problem.h>

#include <deque>
#include <memory>

namespace dsorb::init_orb {
namespace {

std::unique_ptr<ceres::LossFunction> lossOf(const GeometricOptions& options) {
  if (options.loss == RobustLoss::kHuber) {
    return std::make_unique<ceres::HuberLoss>(options.loss_threshold);
  }
  return std::make_unique<ceres::CauchyLoss>(options.loss_threshold);
}

}  // namespace

std::optional<int> solveWithCeres(InitialMap& map,
                                  const PinholeCamera& camera,
                                  const GeometricOptions& options,
                                  const Stopping& stopping) {
  CeresUnknowns unknowns;
  for (const PosedFrame& frame : map.frames) {
    unknowns.poses.push_back(toBlock(frame.T_cam_ref.value_or(SE3())));
  }
  for (const Corner& corner : map.corners) unknowns.inverse_depth.push_back(corner.inverse_depth);
  std::deque<ReprojectionCost> costs;  // Ceres costs cannot move
  PoseManifold manifold;
  const auto loss = lossOf(options);
  ceres::Problem problem(problemOptions());
  for (const CornerObservation& observation : map.observations) {
    if (!map.frames[observation.frame].T_cam_ref) continue;
    costs.emplace_back(camera,
                       camera.unproject(map.corners[observation.corner].pixel),
                       observation.pixel,
                       observation.whitening / options.sigma);
    double* pose = unknowns.poses[observation.frame].data();
    problem.AddResidualBlock(
        &costs.back(), loss.get(), pose, &unknowns.inverse_depth[observation.corner]);
  }
  for (PoseBlock& pose : unknowns.poses) {
    if (problem.HasParameterBlock(pose.data())) setManifold(problem, pose.data(), manifold);
  }
  const auto summary = solveBySchur(problem, unknowns, stopping);
  if (!summary) return std::nullopt;
  for (std::size_t k = 1; k < unknowns.poses.size(); ++k) {
    const double* pose = unknowns.poses[k].data();
    if (problem.HasParameterBlock(pose)) map.frames[k].T_cam_ref = fromBlock(pose);
  }
  for (std::size_t i = 0; i < map.corners.size(); ++i) {
    map.corners[i].inverse_depth = unknowns.inverse_depth[i];
  }
  return static_cast<int>(summary->iterations.size());
}

}  // namespace dsorb::init_orb
