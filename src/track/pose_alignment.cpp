// SPDX-License-Identifier: BSD-3-Clause
#include "track/pose_alignment.h"

#include "base/median.h"
#include "base/parallel.h"
#include "estimate/levenberg_marquardt.h"
#include "track/tracking_covariance.h"

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
constexpr double kStopNorm = 1e-3;       // of a step in scaled units; it is taken unseen
constexpr double kRotationScale = 0.5;   // [rad]
constexpr double kGainScale = 10;        // of a [-]
constexpr double kOffsetScale = 1000;    // of b [grey levels]
constexpr double kMaxCutoffFactor = 50;  // doubling ends above it
constexpr std::size_t kBlocksPerTask = 16;
constexpr std::size_t kNoiseStride = 4;  // points from one that the noise is told by to the next

std::size_t blockCount(std::size_t points) {
  return (points + kAlignmentBlock - 1) / kAlignmentBlock;
}

PointArrays at(const ReferencePoints& points, std::size_t begin) {
  return {points.ray_x.data() + begin,
          points.ray_y.data() + begin,
          points.inverse_depth.data() + begin,
          points.intensity.data() + begin};
}

AlignmentSetting makeSetting(const AlignmentLevel& level, const AlignmentState& state) {
  const TrackingReference& reference = level.reference;
  const PinholeCamera camera = reference.camera.atLevel(level.level);
  const PyramidLevel& image = level.frame.level(level.level);
  const BrightnessTransfer transfer = brightnessTransfer(
      reference.affine, reference.frame->exposure(), state.affine, level.frame.exposure());
  AlignmentSetting s{};
  s.target = makeTargetImage(camera, state.T_cur_ref, transfer, image);
  const auto shutter = shutterOf(level.frame, state.motion, reference.change, level.level);
  if (shutter) s.target.setShutter(*shutter);
  s.affine_b_reference = static_cast<float>(reference.affine.b);
  s.ceiling = level.ceiling;
  return s;
}

/// Equations of any number of unknowns: loops, where fixed sizes would be unrolled into half a
/// minute of compiling.
using SmallMatrix = Eigen::
    Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kRollingParameters, kRollingParameters>;
using SmallVector = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kRollingParameters, 1>;

SmallVector solveDamped(SmallMatrix H, const SmallVector& b, double lambda) {
  H.diagonal() *= 1.0 + lambda;
  return H.ldlt().solve(b);
}

double scaledNorm(const Vector14d& step) {
  Vector8d scaled = step.head<8>();
  scaled.segment<3>(3) /= kRotationScale;
  scaled[6] /= kGainScale;
  scaled[7] /= kOffsetScale;
  return scaled.norm();
}

/// Pose and brightness with the velocity free.
PoseEquations withoutVelocity(const RollingEquations& all) {
  constexpr int kVelocity = kRollingParameters - kAlignmentParameters;
  const Eigen::Matrix<double, kVelocity, kAlignmentParameters> coupling =
      all.H.bottomLeftCorner<kVelocity, kAlignmentParameters>();
  const Eigen::Matrix<double, kVelocity, kAlignmentParameters> solved =
      all.H.bottomRightCorner<kVelocity, kVelocity>().ldlt().solve(coupling);
  PoseEquations reduced;
  reduced.H = all.H.topLeftCorner<kAlignmentParameters, kAlignmentParameters>() -
              coupling.transpose() * solved;
  reduced.b = all.b.head<kAlignmentParameters>() - solved.transpose() * all.b.tail<kVelocity>();
  return reduced;
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
  if (setting_.target.corrected) samples_.time.resize(points);
  block_energies_.resize(blockCount(points));
  block_sums_.resize(blockCount(points) *
                     (setting_.target.corrected ? kRollingSums : kAlignmentSums));
}

Evaluation PoseAlignment::evaluate(const AlignmentLevel& level,
                                   const AlignmentState& state,
                                   double cutoff) {
  points_ = &level.reference.at(level.level);
  setting_ = makeSetting(level, state);
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
          samples_.weight.data() + first,
          setting_.target.corrected ? samples_.time.data() + first : nullptr};
}

template <int kParameters>
AlignmentEquations<kParameters> PoseAlignment::sumBlocks() {
  constexpr std::size_t kSums = triangleSums(kParameters);
  constexpr auto kAccumulate =
      kParameters == kRollingParameters ? accumulateRollingBlock : accumulateBlock;
  const std::size_t blocks = block_energies_.size();
  forEachRange(blocks, kBlocksPerTask, [&](std::size_t begin, std::size_t end) {
    for (std::size_t block = begin; block < end; ++block) {
      const std::size_t first = block * kAlignmentBlock;
      const std::size_t count = std::min(kAlignmentBlock, points_->size() - first);
      float* const sums = block_sums_.data() + block * kSums;
      kAccumulate(setting_, at(*points_, first), samplesFrom(first), count, sums);
    }
  });
  std::array<double, kSums> total{};
  for (std::size_t block = 0; block < blocks; ++block) {
    const float* const sums = block_sums_.data() + block * kSums;
    for (std::size_t i = 0; i < kSums; ++i) total[i] += static_cast<double>(sums[i]);
  }
  AlignmentEquations<kParameters> system;
  addTriangle(total.data(), 0, kParameters, system.H, system.b);
  system.H.template triangularView<Eigen::StrictlyLower>() = system.H.transpose();
  return system;
}

double PoseAlignment::noise() {
  deviations_.clear();
  for (std::size_t i = 0; i < points_->size(); i += kNoiseStride) {
    if (samples_.weight[i] > 0) deviations_.push_back(std::abs(samples_.residual[i]));
  }
  return kMadToSigma * static_cast<double>(medianInPlace(deviations_));
}

PoseEquations PoseAlignment::normalEquations() {
  return sumBlocks<kAlignmentParameters>();
}

RollingEquations PoseAlignment::rollingEquations() {
  return sumBlocks<kRollingParameters>();
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
    if (level.rows != nullptr) {
      const double variance = kResidualsPerMeasurement * current_.meanEnergy();
      velocity_.emplace(*level.rows, variance);
    }
    prior_ = priorEnergy(state);
    linearize();
  }

  std::optional<double> solve(double lambda) {
    if (velocity_) return solveRolling(lambda);
    const Eigen::Index free =
        alignment_.brightness_ == BrightnessModel::kPerfect ? 6 : kAlignmentParameters;
    step_.head(free) =
        -solveDamped(equations_.H.topLeftCorner(free, free), equations_.b.head(free), lambda);
    if (lambda < kLambdaFloor) step_ *= std::pow(kLambdaFloor / lambda, 0.25);
    return step_.allFinite() ? std::optional(0.0) : std::nullopt;
  }

  std::optional<double> tryStep() {
    trial_state_ = state_.plus(step_);
    last_ = scaledNorm(step_) <= kStopNorm;
    if (last_) return 0;
    trial_ = alignment_.evaluate(level_, trial_state_, cutoff_);
    trial_prior_ = priorEnergy(trial_state_);
    const double decrease = current_.meanEnergy(prior_) - trial_.meanEnergy(trial_prior_);
    refused_ = !(decrease > 0);
    return refused_ ? std::nullopt : std::optional(decrease);
  }

  bool accept(const DampedStep& /*step*/) {
    state_ = trial_state_;
    if (last_) return false;
    current_ = trial_;
    prior_ = trial_prior_;
    linearize();
    return true;
  }
  [[nodiscard]] static bool reject(const DampedStep& step) { return step.predicted.has_value(); }

  [[nodiscard]] const Evaluation& current() const { return current_; }
  [[nodiscard]] PoseEquations equations() const {
    if (!velocity_) return equations_;
    return withoutVelocity(rolling_);
  }
  [[nodiscard]] bool cutoffRaised() const { return cutoff_ > kCutoff; }
  /// PoseAlignment::noise() of the current state.
  double noise() {
    if (refused_) (void)alignment_.evaluate(level_, state_, cutoff_);
    return alignment_.noise();
  }

 private:
  [[nodiscard]] double priorEnergy(const AlignmentState& state) const {
    return velocity_ ? velocity_->energy(state.T_cur_ref, state.motion.velocity) : 0;
  }
  void linearize() {
    if (!velocity_) {
      equations_ = alignment_.normalEquations();
      return;
    }
    rolling_ = alignment_.rollingEquations();
    velocity_->addTo(state_.T_cur_ref, state_.motion.velocity, rolling_.H, rolling_.b);
    if (alignment_.brightness_ != BrightnessModel::kPerfect) return;
    for (const Eigen::Index i : {6, 7}) {
      rolling_.H.row(i).setZero();
      rolling_.H.col(i).setZero();
      rolling_.H(i, i) = 1;
      rolling_.b[i] = 0;
    }
  }
  std::optional<double> solveRolling(double lambda) {
    step_ = -solveDamped(rolling_.H, rolling_.b, lambda);
    if (lambda < kLambdaFloor) step_ *= std::pow(kLambdaFloor / lambda, 0.25);
    return step_.allFinite() ? std::optional(0.0) : std::nullopt;
  }

  PoseAlignment& alignment_;
  const AlignmentLevel& level_;
  AlignmentState& state_;
  double cutoff_ = kCutoff;
  Evaluation current_;
  PoseEquations equations_;
  std::optional<VelocityTerm> velocity_;  // of a rolling shutter, which has these equations, too
  RollingEquations rolling_;
  double prior_ = 0;  // energy of the velocity [grey levels^2]
  double trial_prior_ = 0;
  Vector14d step_ = Vector14d::Zero();
  AlignmentState trial_state_;
  bool last_ = false;     // the step is too small to be looked at
  bool refused_ = false;  // what was evaluated last is not the current state
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
  if (level.level == 0) result.noise = problem.noise();
  result.inside_fraction =
      static_cast<double>(current.used) /
      static_cast<double>(std::max<std::size_t>(level.reference.at(level.level).size(), 1));
  result.cutoff_raised = problem.cutoffRaised();
  result.equations = problem.equations();
  return result;
}

}  // namespace dsorb::track
