// SPDX-License-Identifier: BSD-3-Clause
#include "init/coarse/coarse_alignment.h"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>
#include <utility>

namespace dsorb::init_coarse {
namespace {

// Constants of the published front end.
constexpr double kPriorWeight = 150;  // toward no translation and inverse depth 1, square root
                                      // [grey levels / unit]
constexpr double kPriorCap = 2.5;     // of that prior a point [grey levels]
constexpr double kCoupling = 1;       // weight toward the smoothed inverse depth
constexpr double kFirstDamping = 0.1;
constexpr double kMinDamping = 1e-4;
constexpr double kMaxDamping = 1e4;
constexpr double kMinStep = 1e-4;  // norm of [translation; rotation]
constexpr int kMaxFailures = 2;
constexpr double kMaxLogGain = 1;       // beyond the exposures; free, a flat region fits everything
constexpr float kMaxPixelStep = 0.25F;  // of the projection by one depth step [px]
constexpr float kMinInverseDepth = 1e-3F;
constexpr float kMaxInverseDepth = 50.0F;

/// First and one past the last of the parameters that may change.
struct Span {
  int begin;
  int end;
  [[nodiscard]] int size() const { return end - begin; }
};

Span span(Unknowns unknowns, bool brightness) {
  return {unknowns == Unknowns::kRotation ? 3 : 0, brightness ? 8 : 6};
}

bool plausibleBrightness(const Alignment& alignment) {
  return std::abs(alignment.log_gain - alignment.exposure_log_gain) < kMaxLogGain;
}

Alignment moved(const Alignment& alignment, const Vector8d& step) {
  Alignment trial = alignment;
  trial.T_new_ref = SE3::exp(step.head<6>()) * alignment.T_new_ref;
  trial.log_gain += step[6];
  trial.offset += step[7];
  return trial;
}

}  // namespace

double LevelReport::inlierShare() const {
  const NormalEquations& sums = state.equations;
  return sums.good > 0 ? static_cast<double>(sums.inliers) / sums.good : 0.0;
}

double LevelReport::visibleShare() const {
  return points > 0 ? static_cast<double>(state.equations.good) / points : 0.0;
}

void regularize(bool snapped, PointLevel& points) {
  if (snapped) {
    smooth(points);
  } else {
    std::fill(points.smoothed.begin(), points.smoothed.end(), 1.0F);
  }
}

TrivialPrior LevelAligner::trivialPrior(const PointLevel& points,
                                        const Alignment& alignment) const {
  const double n = points.size();
  const double weight = kPriorWeight * kPriorWeight;
  const double cap = kPriorCap * kPriorCap * n;
  double squares = n * alignment.T_new_ref.translation().squaredNorm();
  if (!options_.published) {
    for (std::size_t i = 0; i < points.x.size(); ++i) {
      const auto off = static_cast<double>(points.trial_inverse_depth[i] - 1.0F);
      if (points.good[i] != 0) squares += off * off;
    }
  }
  if (weight * squares > cap || (!options_.published && alignment.snapped)) {
    return {cap, 0, true};
  }
  return {weight * squares, weight, false};
}

LevelState LevelAligner::evaluate(const LevelView& view,
                                  Unknowns unknowns,
                                  PointLevel& points,
                                  const Alignment& alignment) {
  LevelState state;
  if (unknowns != Unknowns::kAll) {
    state.equations = evaluateLevel(view, alignment, {}, points, trial_schur_);
    return state;
  }
  state.prior = trivialPrior(points, alignment);
  const double weight = state.prior.weight;
  const DepthTerms terms{static_cast<float>(weight),
                         static_cast<float>(state.prior.capped ? kCoupling : 0.0)};
  state.equations = evaluateLevel(view, alignment, terms, points, trial_schur_);
  // The gradient of |t|^2 over a left increment is 2 t; the published program takes log T there.
  const Eigen::Vector3d pull = options_.published
                                   ? Eigen::Vector3d(alignment.T_new_ref.log().head<3>())
                                   : alignment.T_new_ref.translation();
  state.equations.H.diagonal().head<3>().array() += weight * points.size();
  state.equations.b.head<3>() += weight * points.size() * pull;
  return state;
}

Vector8d LevelAligner::solve(const LevelState& state, Unknowns unknowns, double damping) const {
  const Span free = span(unknowns, !options_.published);
  const double schur = unknowns == Unknowns::kAll ? 1.0 / (1.0 + damping) : 0.0;
  Matrix8d H = state.equations.H;
  H.diagonal() *= 1.0 + damping;
  H -= schur * state.equations.H_schur;
  const Vector8d b = state.equations.b - schur * state.equations.b_schur;
  Vector8d step = Vector8d::Zero();
  step.segment(free.begin, free.size()) = -H.block(free.begin, free.begin, free.size(), free.size())
                                               .ldlt()
                                               .solve(b.segment(free.begin, free.size()));
  return step.allFinite() ? step : Vector8d::Zero();
}

void LevelAligner::stepDepths(const Vector8d& step, double damping, PointLevel& points) const {
  const Eigen::Matrix<float, 8, 1> s = step.cast<float>();
  const float factor = 1.0F / (1.0F + static_cast<float>(damping));
  for (std::size_t i = 0; i < points.x.size(); ++i) {
    if (points.good[i] == 0) continue;
    const Eigen::Map<const Eigen::Matrix<float, 8, 1>> h(&accepted_schur_.coupling[i * 8]);
    const float limit = kMaxPixelStep * points.max_step[i];
    const float change =
        -accepted_schur_.inverse_curvature[i] * (accepted_schur_.gradient[i] + h.dot(s)) * factor;
    points.trial_inverse_depth[i] =
        std::clamp(points.inverse_depth[i] + std::clamp(change, -limit, limit),
                   kMinInverseDepth,
                   kMaxInverseDepth);
  }
}

void LevelAligner::accept(PointLevel& points) {
  for (std::size_t i = 0; i < points.x.size(); ++i) {
    if (points.good[i] != 0) {
      points.energy[i] = points.trial_energy[i];
      points.good[i] = points.trial_good[i];
      points.inverse_depth[i] = points.trial_inverse_depth[i];
      if (points.trial_good[i] != 0) points.curvature[i] = points.trial_curvature[i];
    } else {
      points.inverse_depth[i] = points.trial_inverse_depth[i] = points.smoothed[i];
    }
  }
  std::swap(accepted_schur_, trial_schur_);
}

double LevelAligner::couplingGain(const PointLevel& points,
                                  const LevelState& accepted,
                                  const LevelState& trial,
                                  bool snapped) const {
  const bool of_accepted = options_.published ? snapped : accepted.prior.capped;
  const bool of_trial = options_.published ? snapped : trial.prior.capped;
  if (!of_accepted && !of_trial) return 0;
  double gain = 0;
  for (std::size_t i = 0; i < points.x.size(); ++i) {
    if (points.trial_good[i] == 0) continue;
    const auto before = static_cast<double>(points.inverse_depth[i] - points.smoothed[i]);
    const auto after = static_cast<double>(points.trial_inverse_depth[i] - points.smoothed[i]);
    gain += (of_trial ? after * after : 0.0) - (of_accepted ? before * before : 0.0);
  }
  return kCoupling * gain;
}

LevelReport LevelAligner::align(const LevelView& view,
                                int max_iterations,
                                Unknowns unknowns,
                                PointLevel& points,
                                Alignment& alignment) {
  std::fill(points.energy.begin(), points.energy.end(), 0.0F);
  LevelReport report;
  report.points = points.size();
  report.state = evaluate(view, unknowns, points, alignment);
  accept(points);
  double damping = kFirstDamping;
  int failures = 0;
  while (report.iterations <= max_iterations && failures < kMaxFailures) {
    ++report.iterations;
    const Vector8d step = solve(report.state, unknowns, damping);
    Alignment trial_alignment = moved(alignment, step);
    if (unknowns == Unknowns::kAll) stepDepths(step, damping, points);
    const LevelState trial = evaluate(view, unknowns, points, trial_alignment);
    double gain = trial.energy() - report.state.energy();
    if (unknowns == Unknowns::kAll) {
      gain += couplingGain(points, report.state, trial, alignment.snapped);
    }
    if (gain < 0 && plausibleBrightness(trial_alignment)) {
      trial_alignment.snapped = alignment.snapped || trial.prior.capped;
      alignment = trial_alignment;
      report.state = trial;
      accept(points);
      if (unknowns == Unknowns::kAll) regularize(alignment.snapped, points);
      damping = std::max(0.5 * damping, kMinDamping);
      failures = 0;
    } else {
      damping = std::min(4.0 * damping, kMaxDamping);
      ++failures;
    }
    if (step.head<6>().norm() <= kMinStep) break;
  }
  return report;
}

}  // namespace dsorb::init_coarse
