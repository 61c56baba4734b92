// SPDX-License-Identifier: BSD-3-Clause
#include "base/parallel.h"
#include "init/orb/bundle/damping.h"
#include "init/orb/photometric/photometric_equations.h"
#include "init/orb/photometric/photometric_solvers.h"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>

namespace dsorb::init_orb {
namespace {

constexpr double kMaxDepthStep = 0.5;  // of an inverse depth in one step, relative to it

/// Damped equations with the depths eliminated, and their solution.
class Elimination {
 public:
  explicit Elimination(const PhotometricProblem& problem)
      : elimination_(problem.patches.size()),
        inverse_(problem.patches.size()),
        depths_(problem.patches.size(), 0.0) {}

  /// @param depths_fixed every depth step is 0
  /// @return predicted decrease of the cost; nullopt when the equations are degenerate
  std::optional<double> solve(const PhotometricEquations& equations,
                              double damping,
                              bool depths_fixed);

  [[nodiscard]] const Eigen::VectorXd& frameStep() const { return frames_; }
  [[nodiscard]] const std::vector<double>& depthStep() const { return depths_; }

 private:
  void eliminate(const PhotometricEquations& equations, double damping);
  void backSubstitute(const PhotometricEquations& equations);

  DepthElimination elimination_;
  std::vector<float> inverse_;  ///< 1 / damped depth Hessian
  Eigen::MatrixXd schur_;
  Eigen::VectorXd right_;
  Eigen::VectorXd frames_;
  std::vector<double> depths_;
};

void Elimination::eliminate(const PhotometricEquations& equations, double damping) {
  for (std::size_t i = 0; i < inverse_.size(); ++i) {
    const float h = equations.depth_hessian[i] * static_cast<float>(1 + damping);
    inverse_[i] = h > 0 ? 1 / h : 0;
  }
  elimination_.subtract(equations, inverse_, schur_, right_);
}

void Elimination::backSubstitute(const PhotometricEquations& equations) {
  const Eigen::VectorXf step = frames_.cast<float>();
  forEachRange(inverse_.size(), kPatchBlock, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const float sum = equations.depth_gradient[i] + equations.couplingOf(i).dot(step);
      depths_[i] = static_cast<double>(-inverse_[i] * sum);
    }
  });
}

std::optional<double> Elimination::solve(const PhotometricEquations& equations,
                                         double damping,
                                         bool depths_fixed) {
  const Eigen::VectorXd diagonal = equations.hessian.diagonal();
  schur_ = equations.hessian;
  schur_.diagonal() += damping * diagonal;
  right_ = equations.gradient;
  if (!depths_fixed) eliminate(equations, damping);
  const Eigen::LLT<Eigen::Ref<Eigen::MatrixXd>, Eigen::Lower> cholesky(schur_);
  if (cholesky.info() != Eigen::Success) return std::nullopt;
  frames_ = -cholesky.solve(right_);
  double decrease = frames_.dot(damping * diagonal.cwiseProduct(frames_) - equations.gradient);
  if (!depths_fixed) {
    backSubstitute(equations);
    for (std::size_t i = 0; i < depths_.size(); ++i) {
      const auto h = static_cast<double>(equations.depth_hessian[i]);
      const auto b = static_cast<double>(equations.depth_gradient[i]);
      decrease += depths_[i] * (damping * h * depths_[i] - b);
    }
  }
  return std::isfinite(decrease) ? std::optional(0.5 * decrease) : std::nullopt;
}

void move(const PhotometricState& from,
          const Elimination& elimination,
          int frame_size,
          PhotometricState& to) {
  for (std::size_t f = 0; f < from.T_cam_ref.size(); ++f) {
    const auto step =
        elimination.frameStep().segment(static_cast<Eigen::Index>(f) * frame_size, frame_size);
    to.T_cam_ref[f] = SE3::exp(step.head<6>()) * from.T_cam_ref[f];
    if (frame_size > 6) to.affine[f] = {from.affine[f].a + step[6], from.affine[f].b + step[7]};
  }
  for (std::size_t i = 0; i < from.inverse_depth.size(); ++i) {
    const double rho = from.inverse_depth[i];
    const double limit = kMaxDepthStep * std::abs(rho);
    to.inverse_depth[i] = rho + std::clamp(elimination.depthStep()[i], -limit, limit);
  }
}

std::optional<PhotometricSolve> minimize(const PhotometricProblem& problem,
                                         const PhotometricOptions& options,
                                         bool depths_fixed,
                                         PhotometricState& state) {
  PhotometricLinearizer linearizer(problem, options);
  Elimination elimination(problem);
  PhotometricEquations equations;
  PhotometricEquations moved_equations;
  PhotometricState moved = state;
  linearizer.linearize(state, equations);
  PhotometricSolve solve;
  solve.first_cost = solve.cost = equations.cost;
  if (!std::isfinite(solve.cost)) return std::nullopt;
  Damping damping;
  while (solve.iterations < options.max_iterations && !damping.exhausted()) {
    ++solve.iterations;
    const std::optional<double> decrease =
        elimination.solve(equations, damping.value, depths_fixed);
    if (decrease) {
      move(state, elimination, equations.frame_size, moved);
      linearizer.linearize(moved, moved_equations);
    }
    if (!decrease || !(moved_equations.cost <= equations.cost)) {
      if (decrease && *decrease < options.function_tolerance * equations.cost) break;
      damping.fail();
      continue;
    }
    const double change = equations.cost - moved_equations.cost;
    damping.succeed(*decrease > 0 ? change / *decrease : 0);
    const bool converged = change <= options.function_tolerance * equations.cost;
    std::swap(state, moved);
    std::swap(equations, moved_equations);
    if (converged) break;
  }
  solve.cost = equations.cost;
  return solve;
}

/// Sums of a run of patches over all frames, poses fixed.
struct DepthSums {
  std::array<float, kPatchBlock> hessian;
  std::array<float, kPatchBlock> gradient;
  std::array<float, kPatchBlock> energy;
};

/// Patches of one block under refinement, each with its own damping.
class DepthBlock {
 public:
  DepthBlock(const PhotometricProblem& problem,
             const std::vector<PatchSetting>& settings,
             std::size_t block)
      : problem_(problem),
        settings_(settings),
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
    DepthSums now;
    DepthSums next;
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

  void evaluate(const std::array<float, kPatchBlock>& inverse_depth, DepthSums& sums) const {
    sums = {};
    std::array<float, kFrameSums> unused{};
    for (std::size_t f = 0; f < settings_.size(); ++f) {
      linearizePatches(settings_[f],
                       {problem_.patches.data() + first_,
                        inverse_depth.data(),
                        problem_.seenIn(f) + first_,
                        count_},
                       {nullptr, 0, sums.hessian.data(), sums.gradient.data(), sums.energy.data()},
                       unused);
    }
  }
  [[nodiscard]] double total(const DepthSums& sums) const {
    double sum = 0;
    for (std::size_t i = 0; i < count_; ++i) sum += static_cast<double>(sums.energy[i]);
    return sum;
  }

  const PhotometricProblem& problem_;
  const std::vector<PatchSetting>& settings_;
  std::size_t first_;
  std::size_t count_;
};

}  // namespace

std::optional<PhotometricSolve> solvePhotometricWithSchur(const PhotometricProblem& problem,
                                                          const PhotometricOptions& options,
                                                          PhotometricState& state) {
  return minimize(problem, options, false, state);
}

std::optional<PhotometricSolve> alignPhotometricPoses(const PhotometricProblem& problem,
                                                      const PhotometricOptions& options,
                                                      PhotometricState& state) {
  return minimize(problem, options, true, state);
}

PhotometricSolve refinePhotometricDepths(const PhotometricProblem& problem,
                                         const PhotometricOptions& options,
                                         PhotometricState& state) {
  std::vector<PatchSetting> settings;
  for (std::size_t f = 0; f < problem.frames.size(); ++f) {
    settings.push_back(patchSetting(
        patchTarget(problem, state, f), options.brightness, static_cast<double>(kHuberThreshold)));
  }
  const std::size_t blocks = (problem.patches.size() + kPatchBlock - 1) / kPatchBlock;
  std::vector<std::pair<double, double>> energies(blocks);
  forEachRange(blocks, 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t block = begin; block < end; ++block) {
      energies[block] = DepthBlock(problem, settings, block)
                            .refine(options.depth_iterations, state.inverse_depth);
    }
  });
  PhotometricSolve solve;
  solve.iterations = options.depth_iterations;
  for (const auto& [before, after] : energies) {
    solve.first_cost += 0.5 * before;
    solve.cost += 0.5 * after;
  }
  return solve;
}

}  // namespace dsorb::init_orb
