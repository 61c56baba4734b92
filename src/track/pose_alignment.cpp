// SPDX-License-Identifier: BSD-3-Clause
#include "track/pose_alignment.h"

#include "base/parallel.h"
#include "estimate/levenberg_marquardt.h"
#include "estimate/robust_loss.h"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>
#include <optional>

namespace dsorb::track {
namespace {

// Constants of the damped iteration: front end of DSO as published.
constexpr double kCutoff = 20;                 // larger residuals are saturated [grey levels]
constexpr double kMaxSaturatedFraction = 0.6;  // the cut-off is doubled while more are saturated
constexpr double kLambdaFloor = 0.001;  // after a rejected step; steps below it are extrapolated
constexpr FactorDamping kDamping{0.01, 0.5, 4, 0, kLambdaFloor};
constexpr double kStopNorm = 1e-3;       // of a step in scaled units
constexpr double kRotationScale = 0.5;   // [rad]
constexpr double kGainScale = 10;        // of a [-]
constexpr double kOffsetScale = 1000;    // of b [grey levels]
constexpr double kMaxCutoffFactor = 50;  // doubling ends above it
constexpr std::size_t kBlocksPerTask = 16;

std::size_t blockCount(std::size_t points) {
  return (points + kAlignmentBlock - 1) / kAlignmentBlock;
}

PointArrays at(const ReferencePoints& points, std::size_t begin) {
  return {points.ray_x.data() + begin,
          points.ray_y.data() + begin,
          points.inverse_depth.data() + begin,
          points.intensity.data() + begin};
}

AlignmentSetting makeSetting(const AlignmentLevel& level,
                             const AlignmentState& state,
                             const PinholeCamera& camera) {
  const TrackingReference& reference = level.reference;
  const PyramidLevel& image = level.frame.level(level.level);
  const BrightnessTransfer transfer = brightnessTransfer(
      reference.affine(), reference.frame().exposure(), state.affine, level.frame.exposure());
  AlignmentSetting s{};
  s.target = makeTargetImage(camera, state.T_frame_reference, transfer, image);
  s.affine_b_reference = static_cast<float>(reference.affine().b);
  s.ceiling = level.ceiling;
  return s;
}

double scaledNorm(const Vector8d& step) {
  Vector8d scaled = step;
  scaled.segment<3>(3) /= kRotationScale;
  scaled[6] /= kGainScale;
  scaled[7] /= kOffsetScale;
  return scaled.norm();
}

}  // namespace

void PoseAlignment::resize(std::size_t points) {
  for (std::vector<float>* values : {&samples_.u,
                                     &samples_.v,
                                     &samples_.rho,
                                     &samples_.dx,
                                     &samples_.dy,
                                     &samples_.residual,
                                     &samples_.weight}) {
    values->resize(points);
  }
  block_energies_.resize(blockCount(points));
  block_sums_.resize(blockCount(points));
}

Evaluation PoseAlignment::evaluate(const AlignmentLevel& level,
                                   const AlignmentState& state,
                                   double cutoff) {
  points_ = &level.reference.points(level.level);
  setting_ = makeSetting(level, state, camera_.atLevel(level.level));
  setting_.huber_threshold = kHuberThreshold;
  setting_.cutoff = static_cast<float>(cutoff);
  resize(points_->size());
  forEachRange(block_energies_.size(), kBlocksPerTask, [&](std::size_t begin, std::size_t end) {
    for (std::size_t block = begin; block < end; ++block) {
      const std::size_t first = block * kAlignmentBlock;
      const std::size_t count = std::min(kAlignmentBlock, points_->size() - first);
      block_energies_[block] =
          evaluateBlock(setting_, at(*points_, first), samplesFrom(first), count);
    }
  });
  Evaluation sum;
  for (const BlockEnergy& block : block_energies_) {
    sum.energy += static_cast<double>(block.energy);
    sum.used += block.used;
    sum.saturated += block.saturated;
  }
  return sum;
}

SampleArrays PoseAlignment::samplesFrom(std::size_t first) {
  return {samples_.u.data() + first,
          samples_.v.data() + first,
          samples_.rho.data() + first,
          samples_.dx.data() + first,
          samples_.dy.data() + first,
          samples_.residual.data() + first,
          samples_.weight.data() + first};
}

PoseEquations PoseAlignment::normalEquations() {
  forEachRange(block_sums_.size(), kBlocksPerTask, [&](std::size_t begin, std::size_t end) {
    for (std::size_t block = begin; block < end; ++block) {
      const std::size_t first = block * kAlignmentBlock;
      const std::size_t count = std::min(kAlignmentBlock, points_->size() - first);
      accumulateBlock(setting_, at(*points_, first), samplesFrom(first), count, block_sums_[block]);
    }
  });
  std::array<double, kAlignmentSums> total{};
  for (const auto& block : block_sums_) {
    for (std::size_t i = 0; i < kAlignmentSums; ++i) total[i] += static_cast<double>(block[i]);
  }
  PoseEquations system;
  const double* next = total.data();
  for (int row = 0; row < kAlignmentParameters; ++row) {
    for (int column = row; column < kAlignmentParameters; ++column) {
      system.H(row, column) = system.H(column, row) = *next++;
    }
    system.b[row] = *next++;
  }
  return system;
}

Evaluation PoseAlignment::evaluateRaisingCutoff(const AlignmentLevel& level,
                                                const AlignmentState& state,
                                                double& cutoff) {
  Evaluation evaluation = evaluate(level, state, cutoff);
  while (evaluation.saturatedFraction() > kMaxSaturatedFraction &&
         cutoff < kMaxCutoffFactor * kCutoff) {
    cutoff *= 2;
    evaluation = evaluate(level, state, cutoff);
  }
  return evaluation;
}

/// One level for minimize().
class PoseAlignment::Problem {
 public:
  Problem(PoseAlignment& alignment, const AlignmentLevel& level, AlignmentState& state)
      : alignment_(alignment), level_(level), state_(state) {
    current_ = alignment.evaluateRaisingCutoff(level, state, cutoff_);
    equations_ = alignment.normalEquations();
  }

  std::optional<double> solve(double lambda) {
    Matrix8d H = equations_.H;
    H.diagonal() *= 1.0 + lambda;
    if (alignment_.brightness_ == BrightnessModel::kPerfect) {
      step_.head<6>() = -H.topLeftCorner<6, 6>().ldlt().solve(equations_.b.head<6>());
    } else {
      step_ = -H.ldlt().solve(equations_.b);
    }
    if (lambda < kLambdaFloor) step_ *= std::pow(kLambdaFloor / lambda, 0.25);
    return step_.allFinite() ? std::optional(0.0) : std::nullopt;
  }

  std::optional<double> tryStep() {
    trial_state_ = state_.plus(step_);
    trial_ = alignment_.evaluate(level_, trial_state_, cutoff_);
    const double decrease = current_.meanEnergy() - trial_.meanEnergy();
    return decrease > 0 ? std::optional(decrease) : std::nullopt;
  }

  bool accept(const DampedStep& /*step*/) {
    state_ = trial_state_;
    current_ = trial_;
    equations_ = alignment_.normalEquations();
    return scaledNorm(step_) > kStopNorm;
  }
  [[nodiscard]] bool reject(const DampedStep& step) const {
    return step.predicted && scaledNorm(step_) > kStopNorm;
  }

  [[nodiscard]] const Evaluation& current() const { return current_; }
  [[nodiscard]] bool cutoffRaised() const { return cutoff_ > kCutoff; }

 private:
  PoseAlignment& alignment_;
  const AlignmentLevel& level_;
  AlignmentState& state_;
  double cutoff_ = kCutoff;
  Evaluation current_;
  PoseEquations equations_;
  Vector8d step_ = Vector8d::Zero();
  AlignmentState trial_state_;
  Evaluation trial_;
};

LevelResult PoseAlignment::align(const AlignmentLevel& level,
                                 int max_iterations,
                                 AlignmentState& state) {
  Problem problem(*this, level, state);
  FactorDamping damping = kDamping;
  LevelResult result;
  result.iterations = minimize(problem, damping, max_iterations);
  const Evaluation& current = problem.current();
  result.rmse = std::sqrt(current.meanEnergy());
  result.saturated_fraction = current.saturatedFraction();
  result.inside_fraction =
      static_cast<double>(current.used) /
      static_cast<double>(std::max<std::size_t>(level.reference.points(level.level).size(), 1));
  result.cutoff_raised = problem.cutoffRaised();
  return result;
}

}  // namespace dsorb::track
