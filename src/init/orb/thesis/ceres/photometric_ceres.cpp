// SPDX-License-Identifier: BSD-3-Clause
#include "estimate/robust_loss.h"
#include "init/orb/photometric/photometric_solvers.h"
#include "init/orb/thesis/ceres/ceres_solve.h"
#include "init/orb/thesis/ceres/photometric_cost.h"
#include "init/orb/thesis/ceres/reprojection_cost.h"

#include <ceres/problem.h>

#include <array>
#include <deque>
#include <memory>

namespace dsorb::init_orb {
namespace {

/// The Ceres problem over the unknowns of a state.
class CeresPhotometry {
 public:
  CeresPhotometry(const PhotometricProblem& problem,
                  const PhotometricOptions& options,
                  const PhotometricState& state);

  std::optional<PhotometricSolve> solve(const PhotometricOptions& options);
  void writeTo(PhotometricState& state) const;

 private:
  static ceres::Problem::Options problemOptions() {
    ceres::Problem::Options options;
    options.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    options.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    return options;
  }
  [[nodiscard]] std::shared_ptr<ceres::ParameterBlockOrdering> ordering();
  void addFrame(const PhotometricProblem& problem, std::size_t frame);

  bool affine_model_;
  std::vector<PoseBlock> poses_;
  std::vector<std::array<double, 2>> affine_;
  std::vector<double> inverse_depths_;
  std::vector<PhotometricCost::Setting> settings_;
  std::deque<PhotometricCost> costs_;  // Ceres costs cannot move
  PoseManifold manifold_;
  ceres::Problem problem_;
};

CeresPhotometry::CeresPhotometry(const PhotometricProblem& problem,
                                 const PhotometricOptions& options,
                                 const PhotometricState& state)
    : affine_model_(options.brightness == PhotometricBrightness::kAffine),
      inverse_depths_(state.inverse_depth),
      problem_(problemOptions()) {
  for (std::size_t f = 0; f < problem.frames.size(); ++f) {
    poses_.push_back(toBlock(state.T_cam_ref[f]));
    affine_.push_back({state.affine[f].a, state.affine[f].b});
    settings_.push_back({patchTarget(problem, state, f),
                         options.brightness,
                         static_cast<double>(kHuberThreshold),
                         problem.reference_exposure,
                         problem.frames[f].exposure});
  }
  for (std::size_t f = 0; f < problem.frames.size(); ++f) addFrame(problem, f);
}

void CeresPhotometry::addFrame(const PhotometricProblem& problem, std::size_t frame) {
  const char* seen = problem.seenIn(frame);
  for (std::size_t i = 0; i < problem.patches.size(); ++i) {
    if (seen[i] == 0) continue;
    costs_.emplace_back(problem.patches[i], settings_[frame]);
    double* depth = &inverse_depths_[i];
    double* pose = poses_[frame].data();
    if (affine_model_) {
      problem_.AddResidualBlock(&costs_.back(), nullptr, pose, affine_[frame].data(), depth);
    } else {
      problem_.AddResidualBlock(&costs_.back(), nullptr, pose, depth);
    }
  }
  if (problem_.HasParameterBlock(poses_[frame].data())) {
    problem_.SetManifold(poses_[frame].data(), &manifold_);
  }
}

std::shared_ptr<ceres::ParameterBlockOrdering> CeresPhotometry::ordering() {
  auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  const auto add = [&](double* block, int group) {
    if (problem_.HasParameterBlock(block)) ordering->AddElementToGroup(block, group);
  };
  for (double& depth : inverse_depths_) add(&depth, 0);
  for (PoseBlock& pose : poses_) add(pose.data(), 1);
  for (auto& affine : affine_) add(affine.data(), 1);
  return ordering;
}

std::optional<PhotometricSolve> CeresPhotometry::solve(const PhotometricOptions& options) {
  const auto summary =
      solveBySchur(problem_, ordering(), options.max_iterations, options.function_tolerance);
  if (!summary) return std::nullopt;
  return PhotometricSolve{
      static_cast<int>(summary->iterations.size()), summary->initial_cost, summary->final_cost};
}

void CeresPhotometry::writeTo(PhotometricState& state) const {
  for (std::size_t f = 0; f < poses_.size(); ++f) {
    state.T_cam_ref[f] = fromBlock(poses_[f].data());
    state.affine[f] = {affine_[f][0], affine_[f][1]};
  }
  state.inverse_depth = inverse_depths_;
}

}  // namespace

std::optional<PhotometricSolve> solvePhotometricWithCeres(const PhotometricProblem& problem,
                                                          const PhotometricOptions& options,
                                                          PhotometricState& state) {
  CeresPhotometry adjustment(problem, options, state);
  const std::optional<PhotometricSolve> solve = adjustment.solve(options);
  if (solve) adjustment.writeTo(state);
  return solve;
}

}  // namespace dsorb::init_orb
