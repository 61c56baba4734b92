// SPDX-License-Identifier: BSD-3-Clause
#include "base/parallel.h"
#include "estimate/schur_problem.h"
#include "init/orb/photometric/photometric_equations.h"
#include "init/orb/photometric/photometric_solvers.h"

#include <algorithm>
#include <cmath>

namespace dsorb::init_orb {
namespace {

constexpr double kMaxDepthStep = 0.5;  // of an inverse depth in one step, relative to it

/// Linearization and update of the state.
struct Model {
  PhotometricLinearizer linearizer;
  int frame_size;

  void linearize(const PhotometricState& state, PhotometricEquations& equations) {
    linearizer.linearize(state, equations);
  }
  void move(const PhotometricState& from,
            const DampedSolver<float>& solution,
            PhotometricState& to) const {
    for (std::size_t f = 0; f < from.T_cam_ref.size(); ++f) {
      const auto step =
          solution.step().segment(static_cast<Eigen::Index>(f) * frame_size, frame_size);
      to.T_cam_ref[f] = SE3::exp(step.head<6>()) * from.T_cam_ref[f];
      if (frame_size > 6) to.affine[f] = {from.affine[f].a + step[6], from.affine[f].b + step[7]};
    }
    for (std::size_t i = 0; i < from.inverse_depth.size(); ++i) {
      const double rho = from.inverse_depth[i];
      const double limit = kMaxDepthStep * std::abs(rho);
      to.inverse_depth[i] = rho + std::clamp(solution.depthStep()[i], -limit, limit);
    }
  }
};

std::optional<PhotometricSolve> solveJointly(const PhotometricProblem& problem,
                                             const PhotometricOptions& options,
                                             bool depths_fixed,
                                             PhotometricState& state) {
  SchurProblem<Model, PhotometricState, PhotometricEquations> adjustment(
      {PhotometricLinearizer(problem), frameSize(problem.brightness)},
      state,
      {options.max_iterations},
      depths_fixed);
  PhotometricSolve solve;
  solve.first_cost = adjustment.cost();
  if (!std::isfinite(solve.first_cost)) return std::nullopt;
  GainDamping damping;
  solve.iterations = minimize(adjustment, damping, options.max_iterations);
  solve.cost = adjustment.cost();
  state = adjustment.state();
  return solve;
}

/// Sums of a run of patches over all frames, poses fixed.
struct BlockSums {
  std::array<float, kPatchBlock> hessian;
  std::array<float, kPatchBlock> gradient;
  std::array<float, kPatchBlock> energy;
};

/// Patches of one block under refinement. A patch has its own damping and takes its own steps, but
/// all are evaluated together in lanes: minimize() has one of both for all that it moves.
class DepthBlock {
 public:
  DepthBlock(const PhotometricProblem& problem,
             const std::vector<PatchImage>& images,
             std::size_t block)
      : problem_(problem),
        images_(images),
        first_(block * kPatchBlock),
        count_(std::min(kPatchBlock, problem.patches.size() - first_)) {}

  /// @return energies before and after
  std::pair<double, double> refine(int iterations, std::vector<double>& inverse_depth) {
    std::array<float, kPatchBlock> rho{};
    std::array<float, kPatchBlock> trial{};
    std::array<float, kPatchBlock> damping{};
    for (std::size_t i = 0; i < count_; ++i) {
      rho[i] = static_cast<float>(inverse_depth[first_ + i]);
      damping[i] = kFirstDamping;
    }
    BlockSums now;
    BlockSums next;
    evaluate(rho, now);
    const double before = total(now);
    for (int iteration = 0; iteration < iterations; ++iteration) {
      for (std::size_t i = 0; i < count_; ++i) {
        const float h = now.hessian[i] * (1 + damping[i]);
        const float limit = static_cast<float>(kMaxDepthStep) * std::abs(rho[i]);
        trial[i] = h > 0 ? rho[i] + std::clamp(-now.gradient[i] / h, -limit, limit) : rho[i];
      }
      evaluate(trial, next);
      for (std::size_t i = 0; i < count_; ++i) {
        const bool better = next.energy[i] < now.energy[i];
        damping[i] = better ? damping[i] / kDampingFactor
                            : std::max(damping[i] * kDampingFactor, kDampingFactor);
        if (!better) continue;
        rho[i] = trial[i];
        now.hessian[i] = next.hessian[i];
        now.gradient[i] = next.gradient[i];
        now.energy[i] = next.energy[i];
      }
    }
    for (std::size_t i = 0; i < count_; ++i) {
      inverse_depth[first_ + i] = static_cast<double>(rho[i]);
    }
    return {before, total(now)};
  }

 private:
  static constexpr float kFirstDamping = 1e-4F;
  static constexpr float kDampingFactor = 4;  // up after a bad step, down after a good one

  void evaluate(const std::array<float, kPatchBlock>& inverse_depth, BlockSums& sums) const {
    sums = {};
    std::array<float, kFrameSums> unused{};
    for (std::size_t f = 0; f < images_.size(); ++f) {
      linearizePatches(
          images_[f],
          {problem_.patches.data() + first_,
           inverse_depth.data(),
           problem_.seenIn(f) + first_,
           count_},
          {{nullptr, 0, sums.hessian.data(), sums.gradient.data()}, sums.energy.data()},
          unused);
    }
    if (problem_.known.empty()) return;
    for (std::size_t i = 0; i < count_; ++i) {
      const KnownTerm term = knownTerm(problem_, first_ + i, static_cast<double>(inverse_depth[i]));
      sums.hessian[i] += static_cast<float>(term.hessian);
      sums.gradient[i] += static_cast<float>(term.gradient);
      sums.energy[i] += static_cast<float>(2 * term.cost);
    }
  }
  [[nodiscard]] double total(const BlockSums& sums) const {
    double sum = 0;
    for (std::size_t i = 0; i < count_; ++i) sum += static_cast<double>(sums.energy[i]);
    return sum;
  }

  const PhotometricProblem& problem_;
  const std::vector<PatchImage>& images_;
  std::size_t first_;
  std::size_t count_;
};

}  // namespace

std::optional<PhotometricSolve> solvePhotometricWithSchur(const PhotometricProblem& problem,
                                                          const PhotometricOptions& options,
                                                          PhotometricState& state) {
  return solveJointly(problem, options, false, state);
}

std::optional<PhotometricSolve> alignPhotometricPoses(const PhotometricProblem& problem,
                                                      const PhotometricOptions& options,
                                                      PhotometricState& state) {
  return solveJointly(problem, options, true, state);
}

PhotometricSolve refinePhotometricDepths(const PhotometricProblem& problem,
                                         int iterations,
                                         PhotometricState& state) {
  std::vector<PatchImage> images;
  for (std::size_t f = 0; f < problem.frames.size(); ++f) {
    images.push_back(patchImage(problem, state, f));
  }
  const std::size_t blocks = (problem.patches.size() + kPatchBlock - 1) / kPatchBlock;
  std::vector<std::pair<double, double>> energies(blocks);
  forEachRange(blocks, 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t block = begin; block < end; ++block) {
      energies[block] = DepthBlock(problem, images, block).refine(iterations, state.inverse_depth);
    }
  });
  PhotometricSolve solve;
  solve.iterations = iterations;
  for (const auto& [before, after] : energies) {
    solve.first_cost += 0.5 * before;
    solve.cost += 0.5 * after;
  }
  return solve;
}

}  // namespace dsorb::init_orb
