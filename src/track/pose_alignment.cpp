// SPDX-License-Identifier: BSD-3-Clause
#include "track/pose_alignment.h"

#include "base/parallel.h"
#include "base/target_clones.h"
#include "estimate/levenberg_marquardt.h"
#include "estimate/robust_loss.h"
#include "estimate/sampling.h"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <optional>
#include <utility>

namespace dsorb::track {
namespace {

/// Columns of one block: Jacobian by the 8 parameters, then the residual.
struct Columns {
  alignas(32) float value[kAlignmentParameters + 1][kAlignmentBlock];
};

template <int kRow>
DSORB_ALWAYS_INLINE void accumulateRow(const Columns& columns,
                                       const float* weight,
                                       std::size_t padded,
                                       float* sums) {
  constexpr int kTerms = kAlignmentParameters + 1 - kRow;
  Lanes total[kTerms] = {};
  for (std::size_t i = 0; i < padded; i += kLanes) {
    Lanes weighted;
    Lanes factor;
    load(weight + i, weighted);
    load(columns.value[kRow] + i, factor);
    weighted *= factor;
    for (int j = 0; j < kTerms; ++j) {
      load(columns.value[kRow + j] + i, factor);
      total[j] += weighted * factor;
    }
  }
  for (int j = 0; j < kTerms; ++j) sums[j] = sumLanes(total[j]);
}

/// The first `count` of eight, zeros after them.
DSORB_ALWAYS_INLINE void loadSome(const float* from, std::size_t count, Lanes& lanes) {
  lanes = Lanes{};
  std::memcpy(&lanes, from, count * sizeof(float));
}
DSORB_ALWAYS_INLINE void storeSome(const Lanes& lanes, std::size_t count, float* to) {
  std::memcpy(to, &lanes, count * sizeof(float));
}

/// Sums over some points, a lane each.
struct LaneEnergy {
  Lanes energy = {};
  MaskOf<Lanes> used = {};
  MaskOf<Lanes> saturated = {};
};

/// Residuals of at most eight points, of which the first is number `i`.
template <bool kRolling>
DSORB_ALWAYS_INLINE void evaluateLanes(const AlignmentSetting& s,
                                       const PointArrays& points,
                                       const SampleArrays& samples,
                                       std::pair<std::size_t, std::size_t> first_count,
                                       LaneEnergy& sums) {
  const auto [i, count] = first_count;
  Lanes ray_x;
  Lanes ray_y;
  Lanes rho;
  Lanes grey;
  loadSome(points.ray_x + i, count, ray_x);
  loadSome(points.ray_y + i, count, ray_y);
  loadSome(points.inverse_depth + i, count, rho);
  loadSome(points.intensity + i, count, grey);
  WarpedPoint<Lanes> p;
  SampleArea<Lanes> area = {};
  MaskOf<Lanes> inside;
  LaneSamples seen;
  projectInto<kRolling>(s.target, ray_x, ray_y, rho, p);
  sampleArea(s.target.width, s.target.height, area);
  sampleTarget(s.target, area, p, seen, inside);
  const Lanes unclipped = s.target.gain * grey + s.target.offset;
  Lanes ceiling;
  fill(s.ceiling, ceiling);
  const Lanes r = seen.intensity - (unclipped < ceiling ? unclipped : ceiling);
  const Lanes magnitude = r < 0.0F ? -r : r;
  const auto used = (rho > 0.0F) & inside & (magnitude <= std::numeric_limits<float>::max());
  const auto unsaturated = used & (magnitude <= s.cutoff);
  Lanes zero = {};
  Lanes bound;
  fill(kHuberThreshold * (2.0F * s.cutoff - kHuberThreshold), bound);
  Lanes weight;
  huberWeights(r, weight);
  sums.energy += unsaturated ? weight * r * r * (2.0F - weight) : (used ? bound : zero);
  sums.used -= used;  // a lane that is true holds -1
  sums.saturated -= used & ~unsaturated;
  storeSome(p.u, count, samples.u + i);
  storeSome(p.v, count, samples.v + i);
  storeSome(rho * p.inverse_z, count, samples.rho + i);
  storeSome(seen.dx, count, samples.dx + i);
  storeSome(seen.dy, count, samples.dy + i);
  storeSome(unsaturated ? r : zero, count, samples.residual + i);
  storeSome(unsaturated ? weight : zero, count, samples.weight + i);
}

int sumOf(const MaskOf<Lanes>& counts) {
  int sum = 0;
  for (int k = 0; k < kLanes; ++k) sum += counts[k];
  return sum;
}

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
  if (level.shutter) s.target.setShutter(*level.shutter);
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

/// Residuals of `count` <= kAlignmentBlock points.
/// r = I_frame(p') - min(gain I_reference + offset, ceiling), p' the projection of the point.
template <bool kRolling>
DSORB_ALWAYS_INLINE BlockEnergy evaluatePoints(const AlignmentSetting& setting,
                                               const PointArrays& points,
                                               const SampleArrays& samples,
                                               std::size_t count) {
  LaneEnergy sums;
  const std::size_t whole = count / kLanes * kLanes;
  for (std::size_t i = 0; i < whole; i += kLanes) {
    evaluateLanes<kRolling>(setting, points, samples, {i, kLanes}, sums);
  }
  if (whole < count) {
    evaluateLanes<kRolling>(setting, points, samples, {whole, count - whole}, sums);
  }
  return {sumLanes(sums.energy), sumOf(sums.used), sumOf(sums.saturated)};
}

DSORB_TARGET_CLONES
BlockEnergy evaluateBlock(const AlignmentSetting& setting,
                          const PointArrays& points,
                          const SampleArrays& samples,
                          std::size_t count) {
  return evaluatePoints<false>(setting, points, samples, count);
}

DSORB_TARGET_CLONES
BlockEnergy evaluateRollingBlock(const AlignmentSetting& setting,
                                 const PointArrays& points,
                                 const SampleArrays& samples,
                                 std::size_t count) {
  return evaluatePoints<true>(setting, points, samples, count);
}

}  // namespace

DSORB_TARGET_CLONES
void accumulateBlock(const AlignmentSetting& setting,
                     const PointArrays& points,
                     const SampleArrays& samples,
                     std::size_t count,
                     std::array<float, kAlignmentSums>& sums) {
  Columns columns;
  alignas(32) float weight[kAlignmentBlock];
  auto& J = columns.value;
  const float gain = setting.target.gain;
  const float b_reference = setting.affine_b_reference;
  for (std::size_t i = 0; i < count; ++i) {
    WarpedPoint<float> p;
    p.u = samples.u[i];
    p.v = samples.v[i];
    RayGradient<float> gradient;
    rayGradient(setting.target.warp, p, samples.dx[i], samples.dy[i], gradient);
    float by_pose[6];
    poseJacobian(p, gradient, samples.rho[i], by_pose);
    for (std::size_t k = 0; k < 6; ++k) J[k][i] = by_pose[k];
    const bool clipped = gain * points.intensity[i] + setting.target.offset >= setting.ceiling;
    J[6][i] = clipped ? 0.0F : gain * (b_reference - points.intensity[i]);
    J[7][i] = clipped ? 0.0F : -1.0F;
    J[8][i] = samples.residual[i];
    weight[i] = samples.weight[i];
  }
  const std::size_t padded = (count + kLanes - 1) / kLanes * kLanes;
  for (std::size_t i = count; i < padded; ++i) {
    for (auto& column : J) column[i] = 0.0F;
    weight[i] = 0.0F;
  }
  float* next = sums.data();
  accumulateRow<0>(columns, weight, padded, next);
  accumulateRow<1>(columns, weight, padded, next + 9);
  accumulateRow<2>(columns, weight, padded, next + 17);
  accumulateRow<3>(columns, weight, padded, next + 24);
  accumulateRow<4>(columns, weight, padded, next + 30);
  accumulateRow<5>(columns, weight, padded, next + 35);
  accumulateRow<6>(columns, weight, padded, next + 39);
  accumulateRow<7>(columns, weight, padded, next + 42);
}

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
  setting_.cutoff = static_cast<float>(cutoff);
  resize(points_->size());
  const auto evaluate_points = setting_.target.rolling ? evaluateRollingBlock : evaluateBlock;
  forEachRange(block_energies_.size(), kBlocksPerTask, [&](std::size_t begin, std::size_t end) {
    for (std::size_t block = begin; block < end; ++block) {
      const std::size_t first = block * kAlignmentBlock;
      const std::size_t count = std::min(kAlignmentBlock, points_->size() - first);
      block_energies_[block] =
          evaluate_points(setting_, at(*points_, first), samplesFrom(first), count);
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
  addTriangle(total.data(), 0, kAlignmentParameters, system.H, system.b);
  system.H.triangularView<Eigen::StrictlyLower>() = system.H.transpose();
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
    last_ = scaledNorm(step_) <= kStopNorm;
    if (last_) return 0;
    trial_ = alignment_.evaluate(level_, trial_state_, cutoff_);
    const double decrease = current_.meanEnergy() - trial_.meanEnergy();
    return decrease > 0 ? std::optional(decrease) : std::nullopt;
  }

  bool accept(const DampedStep& /*step*/) {
    state_ = trial_state_;
    if (last_) return false;
    current_ = trial_;
    equations_ = alignment_.normalEquations();
    return true;
  }
  [[nodiscard]] static bool reject(const DampedStep& step) { return step.predicted.has_value(); }

  [[nodiscard]] const Evaluation& current() const { return current_; }
  [[nodiscard]] const PoseEquations& equations() const { return equations_; }
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
  bool last_ = false;  // the step is too small to be looked at
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
  result.equations = problem.equations();
  return result;
}

}  // namespace dsorb::track
