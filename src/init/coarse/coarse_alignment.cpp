// SPDX-License-Identifier: BSD-3-Clause
#include "init/coarse/coarse_alignment.h"

#include "estimate/levenberg_marquardt.h"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

namespace dsorb::init_coarse {
namespace {

// Constants of the published front end.
constexpr double kPriorWeight = 150;  // toward no translation and inverse depth 1, square root
                                      // [grey levels / unit]
constexpr double kPriorCap = 2.5;     // of that prior a point [grey levels]
constexpr double kCoupling = 1;       // weight toward the smoothed inverse depth
constexpr FactorDamping kDamping{0.1, 0.5, 4, 1e-4, 0, 1e4, 2};
constexpr double kMinStep = 1e-4;       // norm of [translation; rotation]
constexpr double kMaxLogGain = 1;       // beyond the exposures; free, a flat region fits everything
constexpr float kMaxPixelStep = 0.25F;  // of the projection by one depth step [px]
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
  trial.T_cur_ref = SE3::exp(step.head<6>()) * alignment.T_cur_ref;
  trial.log_gain += step[6];
  trial.offset += step[7];
  return trial;
}

}  // namespace

double LevelReport::inlierShare() const {
  return state.sums.good > 0 ? static_cast<double>(state.sums.inliers) / state.sums.good : 0.0;
}

double LevelReport::visibleShare() const {
  return points > 0 ? static_cast<double>(state.sums.good) / points : 0.0;
}

void regularize(bool snapped, PointLevel& points) {
  if (snapped) {
    smooth(points);
  } else {
    std::fill(points.smoothed.begin(), points.smoothed.end(), 1.0F);
  }
}

StationaryUnitPlanePrior LevelAligner::stationaryUnitPlanePrior(const PointLevel& points,
                                                                const Alignment& alignment) const {
  const double n = points.size();
  const double weight = kPriorWeight * kPriorWeight;
  const double cap = kPriorCap * kPriorCap * n;
  double squares = n * alignment.T_cur_ref.translation().squaredNorm();
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
    state.sums = evaluateLevel(view, alignment, {}, points, trial_);
    return state;
  }
  state.prior = stationaryUnitPlanePrior(points, alignment);
  const double weight = state.prior.weight;
  const DepthPull pull{static_cast<float>(weight),
                       static_cast<float>(state.prior.capped ? kCoupling : 0.0)};
  state.sums = evaluateLevel(view, alignment, pull, points, trial_);
  // The gradient of |t|^2 over a left increment is 2 t; the published program takes log T there.
  const Eigen::Vector3d shift = options_.published
                                    ? Eigen::Vector3d(alignment.T_cur_ref.log().head<3>())
                                    : alignment.T_cur_ref.translation();
  trial_.H.diagonal().head<3>().array() += weight * points.size();
  trial_.b.head<3>() += weight * points.size() * shift;
  return state;
}

Vector8d LevelAligner::solve(Unknowns unknowns, double damping) {
  const Span free = span(unknowns, !options_.published);
  Eigen::MatrixXd H = accepted_.H;
  Eigen::VectorXd b = accepted_.b;
  H.diagonal() *= 1.0 + damping;
  if (unknowns == Unknowns::kAll) {
    elimination_.damp(accepted_, damping);
    elimination_.eliminate(accepted_, H, b);
  }
  Vector8d step = Vector8d::Zero();
  step.segment(free.begin, free.size()) = -H.block(free.begin, free.begin, free.size(), free.size())
                                               .ldlt()
                                               .solve(b.segment(free.begin, free.size()));
  return step.allFinite() ? step : Vector8d::Zero();
}

void LevelAligner::stepDepths(const Vector8d& step, PointLevel& points) {
  elimination_.substituteBack(accepted_, step, depth_step_);
  for (std::size_t i = 0; i < points.x.size(); ++i) {
    if (points.good[i] == 0) continue;
    const float limit = kMaxPixelStep * points.max_step[i];
    points.trial_inverse_depth[i] = std::clamp(
        points.inverse_depth[i] + std::clamp(static_cast<float>(depth_step_[i]), -limit, limit),
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
  std::swap(accepted_, trial_);
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

/// One level for minimize().
class LevelAligner::Problem {
 public:
  Problem(LevelAligner& aligner,
          const LevelView& view,
          Unknowns unknowns,
          PointLevel& points,
          Alignment& alignment)
      : aligner_(aligner),
        view_(view),
        unknowns_(unknowns),
        points_(points),
        alignment_(alignment),
        state_(aligner.evaluate(view, unknowns, points, alignment)) {
    aligner_.accept(points_);
  }

  std::optional<double> solve(double damping) {
    step_ = aligner_.solve(unknowns_, damping);
    trial_alignment_ = moved(alignment_, step_);
    if (unknowns_ == Unknowns::kAll) aligner_.stepDepths(step_, points_);
    return 0;
  }

  std::optional<double> tryStep() {
    trial_ = aligner_.evaluate(view_, unknowns_, points_, trial_alignment_);
    double decrease = state_.energy() - trial_.energy();
    if (unknowns_ == Unknowns::kAll) {
      decrease -= aligner_.couplingGain(points_, state_, trial_, alignment_.snapped);
    }
    const bool better = decrease > 0 && plausibleBrightness(trial_alignment_);
    return better ? std::optional(decrease) : std::nullopt;
  }

  bool accept(const DampedStep& /*step*/) {
    trial_alignment_.snapped = alignment_.snapped || trial_.prior.capped;
    alignment_ = trial_alignment_;
    state_ = trial_;
    aligner_.accept(points_);
    if (unknowns_ == Unknowns::kAll) regularize(alignment_.snapped, points_);
    return movesOn();
  }
  [[nodiscard]] bool reject(const DampedStep& /*step*/) const { return movesOn(); }

  [[nodiscard]] const LevelState& state() const { return state_; }

 private:
  [[nodiscard]] bool movesOn() const { return step_.head<6>().norm() > kMinStep; }

  LevelAligner& aligner_;
  const LevelView& view_;
  Unknowns unknowns_;
  PointLevel& points_;
  Alignment& alignment_;
  LevelState state_;
  LevelState trial_;
  Alignment trial_alignment_;
  Vector8d step_ = Vector8d::Zero();
};

LevelReport LevelAligner::align(const LevelView& view,
                                int max_iterations,
                                Unknowns unknowns,
                                PointLevel& points,
                                Alignment& alignment) {
  std::fill(points.energy.begin(), points.energy.end(), 0.0F);
  Problem problem(*this, view, unknowns, points, alignment);
  FactorDamping damping = kDamping;
  LevelReport report;
  report.iterations = minimize(problem, damping, max_iterations + 1);
  report.points = points.size();
  report.state = problem.state();
  return report;
}

}  // namespace dsorb::init_coarse
