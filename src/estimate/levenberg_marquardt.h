// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <optional>

namespace dsorb {

/// One trial of the loop below.
struct DampedStep {
  std::optional<double> predicted;  ///< decrease of the cost by the equations; none: degenerate
  std::optional<double> decrease;   ///< that came out, where the step is taken
};

/// Levenberg-Marquardt. A problem holds an accepted state with its equations and a trial state, and
/// knows how to
///   std::optional<double> solve(double damping)  find the step that the accepted equations want;
///       @return decrease of the cost that they predict (any number where the damping rule does not
///       ask for it), none when they are degenerate;
///   std::optional<double> tryStep()  move a copy of the state and linearize there;
///       @return decrease of the cost if that is good enough to be accepted;
///   bool accept(const DampedStep&)   make the trial the accepted state; @return whether to go on;
///   bool reject(const DampedStep&)   the other case.
/// A damping rule has `value`, succeed(step), fail(), and exhausted(), which ends the loop.
/// @return iterations
template <typename Problem, typename Damping>
int minimize(Problem& problem, Damping& damping, int max_iterations) {
  int iterations = 0;
  bool goes_on = true;
  while (goes_on && iterations < max_iterations && !damping.exhausted()) {
    ++iterations;
    DampedStep step;
    step.predicted = problem.solve(damping.value);
    if (step.predicted) step.decrease = problem.tryStep();
    if (step.decrease) {
      damping.succeed(step);
      goes_on = problem.accept(step);
    } else {
      damping.fail();
      goes_on = problem.reject(step);
    }
  }
  return iterations;
}

/// Falls with the agreement of cost and prediction, rises faster and faster without.
/// @source Madsen, Nielsen, Tingleff, Methods for Non-Linear Least Squares Problems, algorithm 3.16
struct GainDamping {
  double value = 1e-4;  ///< relative to the diagonal; first: Ceres' trust region of radius 1e4
  double growth = 2;

  void succeed(const DampedStep& step) {
    const double gain = *step.predicted > 0 ? *step.decrease / *step.predicted : 0;
    const double x = 2 * gain - 1;
    value *= std::max(1.0 / 3, 1 - x * x * x);
    growth = 2;
  }
  void fail() {
    value *= growth;
    growth *= 2;
  }
  /// No step lowers the cost any more.
  [[nodiscard]] bool exhausted() const { return value > 1e16; }
};

/// Falls and rises by constant factors.
/// @source the direct methods of DSO as published: front end, tracker and window
struct FactorDamping {
  double value;             ///< relative to the diagonal
  double down;              ///< factor after an accepted step
  double up;                ///< factor after a rejected one
  double min = 0;           ///< after an accepted step it is at least this ...
  double min_rejected = 0;  ///< ... and after a rejected one this
  double max = 1e300;
  int max_failures = 1 << 30;  ///< in a row
  int failures = 0;

  void succeed(const DampedStep& /*step*/) {
    value = std::max(down * value, min);
    failures = 0;
  }
  void fail() {
    value = std::clamp(up * value, min_rejected, max);
    ++failures;
  }
  [[nodiscard]] bool exhausted() const { return failures >= max_failures; }
};

}  // namespace dsorb
