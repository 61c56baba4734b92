// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "estimate/levenberg_marquardt.h"
#include "estimate/linear_system.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

namespace dsorb {

/// When a solution ends.
struct Stopping {
  int max_iterations = 20;
  double cost_change = 1e-6;  ///< less than this share of the cost; default of Ceres
};

/// A problem for minimize() over states of frames and inverse depths, solved by elimination. Ends
/// where the cost changes, or is predicted to change, by less than the share of itself.
/// @tparam Model     linearize(state, equations) and move(state, solver, moved state)
/// @tparam Equations has a LinearSystem<double> `system` and a `cost`, infinite or NaN where there
/// is none
template <typename Model, typename State, typename Equations>
class SchurProblem {
 public:
  SchurProblem(Model model, State state, const Stopping& stopping)
      : model_(std::move(model)),
        cost_change_(stopping.cost_change),
        state_(std::move(state)),
        moved_(state_) {
    model_.linearize(state_, equations_);
  }

  [[nodiscard]] const State& state() const { return state_; }
  [[nodiscard]] double cost() const { return equations_.cost; }
  /// No entry of the gradient is worth a step.
  [[nodiscard]] bool atMinimum() const {
    const auto small = [](double entry) { return std::abs(entry) < kMinGradient; };
    const auto& system = equations_.system;
    return std::all_of(system.b.data(), system.b.data() + system.b.size(), small) &&
           std::all_of(system.depth_gradient.begin(), system.depth_gradient.end(), small);
  }

  std::optional<double> solve(double damping) { return solver_.solve(equations_.system, damping); }
  std::optional<double> tryStep() {
    model_.move(state_, solver_, moved_);
    model_.linearize(moved_, moved_equations_);
    const double decrease = equations_.cost - moved_equations_.cost;
    return decrease >= 0 ? std::optional(decrease) : std::nullopt;
  }
  bool accept(const DampedStep& step) {
    const bool converged = *step.decrease <= cost_change_ * equations_.cost;
    std::swap(state_, moved_);
    std::swap(equations_, moved_equations_);
    return !converged && !atMinimum();
  }
  [[nodiscard]] bool reject(const DampedStep& step) const {
    return !step.predicted || *step.predicted >= cost_change_ * equations_.cost;
  }

 private:
  static constexpr double kMinGradient = 1e-10;  // default of Ceres

  Model model_;
  double cost_change_;
  State state_;
  State moved_;
  Equations equations_;
  Equations moved_equations_;
  DampedSolver solver_;
};

/// Moves a problem to its minimum.
/// @return iterations, or nullopt where it has no usable numbers
template <typename Model, typename State, typename Equations>
std::optional<int> minimize(SchurProblem<Model, State, Equations>& problem,
                            const Stopping& stopping) {
  if (!std::isfinite(problem.cost())) return std::nullopt;
  GainDamping damping;
  return problem.atMinimum() ? 0 : minimize(problem, damping, stopping.max_iterations);
}

}  // namespace dsorb
