// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/bundle/adjustment_solvers.h"
#include "init/orb/thesis/ceres/ceres_solve.h"
#include "init/orb/thesis/ceres/reprojection_cost.h"

#include <ceres/loss_function.h>
#include <ceres/problem.h>

#include <cstddef>
#include <deque>
#include <memory>
#include <utility>

namespace dsorb::init_orb {
namespace {

/// The Ceres problem over the poses and inverse depths of a map.
class CeresAdjustment {
 public:
  CeresAdjustment(const InitialMap& map,
                  const std::vector<char>& kept,
                  const PinholeCamera& camera,
                  const GeometricOptions& options);

  [[nodiscard]] std::optional<int> solve(const GeometricOptions& options);
  void writeTo(InitialMap& map) const;

 private:
  std::vector<PoseBlock> poses_;
  std::vector<double> inverse_depths_;
  std::deque<ReprojectionCost> costs_;  // Ceres costs cannot move
  PoseManifold manifold_;
  std::unique_ptr<ceres::LossFunction> loss_;
  ceres::Problem problem_;
};

ceres::Problem::Options problemOptions() {
  ceres::Problem::Options options;
  options.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  options.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  return options;
}

std::unique_ptr<ceres::LossFunction> lossOf(const GeometricOptions& options) {
  if (options.loss == RobustLoss::kHuber) {
    return std::make_unique<ceres::HuberLoss>(options.loss_threshold);
  }
  return std::make_unique<ceres::CauchyLoss>(options.loss_threshold);
}

CeresAdjustment::CeresAdjustment(const InitialMap& map,
                                 const std::vector<char>& kept,
                                 const PinholeCamera& camera,
                                 const GeometricOptions& options)
    : poses_(map.frames.size()), loss_(lossOf(options)), problem_(problemOptions()) {
  for (std::size_t k = 0; k < map.frames.size(); ++k) {
    if (map.frames[k].T_cam_ref) {
      poses_[k] = toBlock(*map.frames[k].T_cam_ref);
    }
  }
  inverse_depths_.reserve(map.corners.size());
  for (const Corner& corner : map.corners) {
    inverse_depths_.push_back(corner.inverse_depth);
  }
  for (const Observation& observation : map.observations) {
    const auto corner = static_cast<std::size_t>(observation.corner);
    const auto frame = static_cast<std::size_t>(observation.frame);
    if (kept[corner] == 0 || !map.frames[frame].T_cam_ref) {
      continue;
    }
    costs_.emplace_back(camera,
                        camera.unproject(map.corners[corner].pixel),
                        observation.pixel,
                        observation.whitening / options.sigma);
    problem_.AddResidualBlock(
        &costs_.back(), loss_.get(), poses_[frame].data(), &inverse_depths_[corner]);
  }
  for (PoseBlock& pose : poses_) {
    if (problem_.HasParameterBlock(pose.data())) {
      problem_.SetManifold(pose.data(), &manifold_);
    }
  }
}

std::optional<int> CeresAdjustment::solve(const GeometricOptions& options) {
  auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  for (double& inverse_depth : inverse_depths_) {
    if (problem_.HasParameterBlock(&inverse_depth)) {
      ordering->AddElementToGroup(&inverse_depth, 0);
    }
  }
  for (PoseBlock& pose : poses_) {
    if (problem_.HasParameterBlock(pose.data())) {
      ordering->AddElementToGroup(pose.data(), 1);
    }
  }
  const auto summary = solveBySchur(
      problem_, std::move(ordering), options.max_iterations, options.function_tolerance);
  if (!summary) return std::nullopt;
  return static_cast<int>(summary->iterations.size());
}

void CeresAdjustment::writeTo(InitialMap& map) const {
  for (std::size_t k = 1; k < poses_.size(); ++k) {
    if (problem_.HasParameterBlock(poses_[k].data())) {
      map.frames[k].T_cam_ref = fromBlock(poses_[k].data());
    }
  }
  for (std::size_t i = 0; i < inverse_depths_.size(); ++i) {
    map.corners[i].inverse_depth = inverse_depths_[i];
  }
}

}  // namespace

std::optional<int> solveWithCeres(InitialMap& map,
                                  const std::vector<char>& kept,
                                  const PinholeCamera& camera,
                                  const GeometricOptions& options) {
  CeresAdjustment adjustment(map, kept, camera, options);
  const std::optional<int> iterations = adjustment.solve(options);
  if (iterations) {
    adjustment.writeTo(map);
  }
  return iterations;
}

}  // namespace dsorb::init_orb
