// SPDX-License-Identifier: BSD-3-Clause
#include "estimate/robust_loss.h"
#include "init/orb/photometric/photometric_solvers.h"
#include "init/orb/thesis/ceres/ceres_solve.h"
#include "init/orb/thesis/ceres/photometric_cost.h"

#include <ceres/problem.h>

#include <deque>

namespace dsorb::init_orb {

std::optional<PhotometricSolve> solvePhotometricWithCeres(const PhotometricProblem& problem,
                                                          const PhotometricOptions& options,
                                                          PhotometricState& state) {
  const bool affine = options.brightness == PhotometricBrightness::kAffine;
  const std::size_t frames = problem.frames.size();
  CeresUnknowns unknowns;
  unknowns.inverse_depth = state.inverse_depth;
  std::vector<PhotometricCost::Setting> settings;
  for (std::size_t f = 0; f < frames; ++f) {
    unknowns.poses.push_back(toBlock(state.T_cam_ref[f]));
    if (affine) unknowns.affine.push_back({state.affine[f].a, state.affine[f].b});
    settings.push_back({patchTarget(problem, state, f),
                        options.brightness,
                        static_cast<double>(kHuberThreshold),
                        problem.reference_exposure,
                        problem.frames[f].exposure});
  }
  std::deque<PhotometricCost> costs;  // Ceres costs cannot move
  PoseManifold manifold;
  ceres::Problem adjustment(problemOptions());
  for (std::size_t f = 0; f < frames; ++f) {
    double* pose = unknowns.poses[f].data();
    for (std::size_t i = 0; i < problem.patches.size(); ++i) {
      if (problem.seenIn(f)[i] == 0) continue;
      costs.emplace_back(problem.patches[i], settings[f]);
      std::vector<double*> blocks = {pose};
      if (affine) blocks.push_back(unknowns.affine[f].data());
      blocks.push_back(&unknowns.inverse_depth[i]);
      adjustment.AddResidualBlock(&costs.back(), nullptr, blocks);
    }
    if (adjustment.HasParameterBlock(pose)) setManifold(adjustment, pose, manifold);
  }
  const auto summary = solveBySchur(adjustment, unknowns, {options.max_iterations});
  if (!summary) return std::nullopt;
  for (std::size_t f = 0; f < frames; ++f) {
    state.T_cam_ref[f] = fromBlock(unknowns.poses[f].data());
    if (affine) state.affine[f] = {unknowns.affine[f][0], unknowns.affine[f][1]};
  }
  state.inverse_depth = unknowns.inverse_depth;
  return PhotometricSolve{
      static_cast<int>(summary->iterations.size()), summary->initial_cost, summary->final_cost};
}

}  // namespace dsorb::init_orb
