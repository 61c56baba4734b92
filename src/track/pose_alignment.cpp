// SPDX-License-Identifier: BSD-3-Clause
#include "track/pose_alignment.h"

#include "base/median.h"
#include "base/parallel.h"
#include "base/target_clones.h"
#include "estimate/levenberg_marquardt.h"
#include "estimate/robust_loss.h"
#include "estimate/sampling.h"
#include "estimate/variance_factors.h"

#include <Eigen/Cholesky>
#include <Eigen/Core>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <optional>
#include <utility>

namespace dsorb::track {
namespace {

/// Columns of one block: Jacobian by the parameters, then the residual.
template <int kParameters>
struct Columns {
  alignas(32) float value[kParameters + 1][kAlignmentBlock];
};

template <int kRow, int kParameters>
DSORB_ALWAYS_INLINE void accumulateRow(const Columns<kParameters>& columns,
                                       const float* weight,
                                       std::size_t padded,
                                       float* sums) {
  constexpr int kTerms = kParameters + 1 - kRow;
  Lanes total[kTerms] = {};
  for (std::size_t i = 0; i < padded; i += kLanes) {
    const Lanes weighted = load(weight + i) * load(columns.value[kRow] + i);
    for (int j = 0; j < kTerms; ++j) total[j] += weighted * load(columns.value[kRow + j] + i);
  }
  for (int j = 0; j < kTerms; ++j) sums[j] = sumLanes(total[j]);
}

/// The first `count` of eight, zeros after them.
DSORB_ALWAYS_INLINE Lanes loadSome(const float* from, std::size_t count) {
  Lanes lanes = {};
  std::memcpy(&lanes, from, count * sizeof(float));
  return lanes;
}
DSORB_ALWAYS_INLINE void storeSome(const Lanes& lanes, std::size_t count, float* to) {
  std::memcpy(to, &lanes, count * sizeof(float));
}

/// Sums over some points, a lane each.
struct LaneEnergy {
  Lanes energy = {};
  MaskOf<Lanes> used = {};
};

constexpr float kCutoff = 20;  // larger residuals are saturated [grey levels]; DSO as published

/// Residuals of at most eight points.
template <bool kRolling>
DSORB_ALWAYS_INLINE void evaluateLanes(const AlignmentSetting& s,
                                       const ReferencePoints& points,
                                       const AlignmentBlock& eight,
                                       AlignmentSamples& samples,
                                       LaneEnergy& sums) {
  const auto [i, count] = eight;
  const Lanes ray_x = loadSome(points.ray_x.data() + i, count);
  const Lanes ray_y = loadSome(points.ray_y.data() + i, count);
  const Lanes rho = loadSome(points.inverse_depth.data() + i, count);
  const Lanes grey = loadSome(points.intensity.data() + i, count);
  const WarpedPoint<Lanes> p = projectInto<kRolling>(s.target, ray_x, ray_y, rho);
  MaskOf<Lanes> inside;
  LaneSamples seen = sampleTarget(s.target, p, inside);
  unbendGradients<kRolling>(s.target, p, seen);
  const Lanes unclipped = s.target.gain * grey + s.target.offset;
  const auto ceiling = spread<Lanes>(s.ceiling);
  const Lanes r = seen.intensity - (unclipped < ceiling ? unclipped : ceiling);
  const Lanes magnitude = r < 0.0F ? -r : r;
  const auto used = (rho > 0.0F) & inside & (magnitude <= std::numeric_limits<float>::max());
  const auto unsaturated = used & (magnitude <= kCutoff);
  const Lanes zero = {};
  const auto bound = spread<Lanes>(kHuberThreshold * (2.0F * kCutoff - kHuberThreshold));
  const Lanes weight = huberWeights(r);
  sums.energy += unsaturated ? huberEnergies(r, weight) : (used ? bound : zero);
  sums.used -= used;  // a lane that is true holds -1
  storeSome(p.u, count, samples.u.data() + i);
  storeSome(p.v, count, samples.v.data() + i);
  storeSome(rho * p.inverse_z, count, samples.rho.data() + i);
  storeSome(seen.dx, count, samples.dx.data() + i);
  storeSome(seen.dy, count, samples.dy.data() + i);
  storeSome(unsaturated ? r : zero, count, samples.residual.data() + i);
  storeSome(unsaturated ? weight : zero, count, samples.weight.data() + i);
  if constexpr (kRolling) {
    const Lanes time = rowTime(s.target.shutter, p.x, p.y);
    // The time of a point behind the camera may be no number, which no weight removes.
    storeSome(unsaturated ? time : zero, count, samples.time.data() + i);
  }
}

template <bool kRolling>
DSORB_ALWAYS_INLINE void evaluatePoints(const AlignmentSetting& setting,
                                        const ReferencePoints& points,
                                        const AlignmentBlock& block,
                                        AlignmentSamples& samples,
                                        LaneEnergy& result) {
  LaneEnergy sums;  // a local one stays in registers
  const std::size_t end = block.first + block.count;
  const std::size_t whole = end - block.count % kLanes;
  for (std::size_t i = block.first; i < whole; i += kLanes) {
    evaluateLanes<kRolling>(setting, points, {i, kLanes}, samples, sums);
  }
  if (whole < end) evaluateLanes<kRolling>(setting, points, {whole, end - whole}, samples, sums);
  result = sums;
}

DSORB_TARGET_CLONES
void evaluateBlock(const AlignmentSetting& setting,
                   const ReferencePoints& points,
                   const AlignmentBlock& block,
                   AlignmentSamples& samples,
                   LaneEnergy& sums) {
  setting.target.corrected ? evaluatePoints<true>(setting, points, block, samples, sums)
                           : evaluatePoints<false>(setting, points, block, samples, sums);
}

int sumOf(const MaskOf<Lanes>& counts) {
  int sum = 0;
  for (int k = 0; k < kLanes; ++k) sum += counts[k];
  return sum;
}

template <int kParameters, int... kRows>
DSORB_ALWAYS_INLINE void accumulateRows(const Columns<kParameters>& columns,
                                        const float* weight,
                                        std::size_t padded,
                                        float* sums,
                                        std::integer_sequence<int, kRows...> /*rows*/) {
  constexpr auto kBegin = [](int row) {
    return static_cast<std::ptrdiff_t>(row * (kParameters + 1) - row * (row - 1) / 2);
  };
  (accumulateRow<kRows>(columns, weight, padded, sums + kBegin(kRows)), ...);
}

template <int kParameters>
DSORB_ALWAYS_INLINE void accumulatePoints(const AlignmentSetting& setting,
                                          const ReferencePoints& points,
                                          const AlignmentSamples& samples,
                                          const AlignmentBlock& block,
                                          float* sums) {
  constexpr bool kRolling = kParameters == kRollingParameters;
  Columns<kParameters> columns;
  alignas(32) float weight[kAlignmentBlock];
  auto& J = columns.value;
  const float gain = setting.target.gain;
  const float b_reference = setting.affine_b_reference;
  for (std::size_t i = 0; i < block.count; ++i) {
    const std::size_t from = block.first + i;
    WarpedPoint<float> p;
    p.u = samples.u[from];
    p.v = samples.v[from];
    const RayGradient<float> gradient =
        rayGradient(setting.target.warp, p, samples.dx[from], samples.dy[from]);
    float by_pose[6];
    poseJacobian(p, gradient, samples.rho[from], by_pose);
    for (std::size_t k = 0; k < 6; ++k) J[k][i] = by_pose[k];
    const float grey = points.intensity[from];
    const bool clipped = gain * grey + setting.target.offset >= setting.ceiling;
    J[6][i] = clipped ? 0.0F : gain * (b_reference - grey);
    J[7][i] = clipped ? 0.0F : -1.0F;
    if constexpr (kRolling) {
      for (std::size_t k = 0; k < 6; ++k) J[8 + k][i] = samples.time[from] * by_pose[k];
    }
    J[kParameters][i] = samples.residual[from];
    weight[i] = samples.weight[from];
  }
  const std::size_t padded = (block.count + kLanes - 1) / kLanes * kLanes;
  for (std::size_t i = block.count; i < padded; ++i) {
    for (auto& column : J) column[i] = 0.0F;
    weight[i] = 0.0F;
  }
  accumulateRows(columns, weight, padded, sums, std::make_integer_sequence<int, kParameters>());
}

// Constants of the damped iteration: front end of DSO as published.
constexpr double kLambdaFloor = 0.001;  // after a rejected step; steps below it are extrapolated
constexpr FactorDamping kDamping{0.01, 0.5, 4, 0, kLambdaFloor};
constexpr double kStopNorm = 1e-3;      // of a step in scaled units; it is taken unseen
constexpr double kRotationScale = 0.5;  // [rad]
constexpr double kGainScale = 10;       // of a [-]
constexpr double kOffsetScale = 1000;   // of b [grey levels]
constexpr std::size_t kBlocksPerTask = 16;
constexpr std::size_t kNoiseStride = 4;  // points from one that the noise is told by to the next

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

/// Pose and brightness with the velocity, where it is among the unknowns, free.
PoseEquations withoutVelocity(const SmallMatrix& H, const SmallVector& b) {
  PoseEquations reduced{H.topLeftCorner<8, 8>(), b.head<8>()};
  const Eigen::Index velocity = b.size() - kAlignmentParameters;
  if (velocity == 0) return reduced;
  const Eigen::Matrix<double, 6, 8> coupling = H.bottomLeftCorner<6, 8>();
  const Eigen::Matrix<double, 6, 8> solved = H.bottomRightCorner<6, 6>().ldlt().solve(coupling);
  reduced.H -= coupling.transpose() * solved;
  reduced.b -= solved.transpose() * b.tail<6>();
  return reduced;
}

/// Upper left 6 x 6 of the inverse, brightness being free.
template <int kSize>
std::optional<Matrix6d> inversePoseBlock(const Eigen::Matrix<double, kSize, kSize>& H) {
  using Square = Eigen::Matrix<double, kSize, kSize>;
  const Eigen::LLT<Square> cholesky(H);
  if (cholesky.info() != Eigen::Success) return std::nullopt;
  const Square inverse = cholesky.solve(Square::Identity());
  return Matrix6d(inverse.template topLeftCorner<6, 6>());
}

}  // namespace

VelocityTerm::VelocityTerm(const RowsOfFrame& rows, double variance)
    : rows_(rows), information_(variance * rows.sigma.cwiseAbs2().cwiseInverse()) {
  // The parabola through 0, -x at t1 and -x at t2 has the velocity -x (1 / t1 + 1 / t2).
  double nearest = 0;
  for (const TimedPose& pose : rows.recent) {
    const double time = pose.time - rows.timestamp;
    if (time == 0 || time == nearest) continue;
    by_pose_ += 1 / time;
    if (nearest != 0) break;
    nearest = time;
  }
}

double VelocityTerm::energy(const SE3& T_cur_ref, const Vector6d& velocity) const {
  return error(T_cur_ref, velocity).cwiseAbs2().dot(information_);
}

DSORB_TARGET_CLONES
void accumulateBlock(const AlignmentSetting& setting,
                     const ReferencePoints& points,
                     const AlignmentSamples& samples,
                     const AlignmentBlock& block,
                     float* sums) {
  accumulatePoints<kAlignmentParameters>(setting, points, samples, block, sums);
}

DSORB_TARGET_CLONES
void accumulateRollingBlock(const AlignmentSetting& setting,
                            const ReferencePoints& points,
                            const AlignmentSamples& samples,
                            const AlignmentBlock& block,
                            float* sums) {
  accumulatePoints<kRollingParameters>(setting, points, samples, block, sums);
}

template <typename Function>
void PoseAlignment::forEachBlock(const Function& function) {
  forEachRange(block_energies_.size(), kBlocksPerTask, [&](std::size_t begin, std::size_t end) {
    for (std::size_t number = begin; number < end; ++number) {
      const std::size_t first = number * kAlignmentBlock;
      const std::size_t count = std::min(kAlignmentBlock, points_->size() - first);
      function(number, AlignmentBlock{first, count});
    }
  });
}

Evaluation PoseAlignment::evaluate(const AlignmentLevel& level, const AlignmentState& state) {
  points_ = &level.reference.at(level.level);
  setting_ = makeSetting(level, state);
  for (std::vector<float>* values : {&samples_.u,
                                     &samples_.v,
                                     &samples_.rho,
                                     &samples_.dx,
                                     &samples_.dy,
                                     &samples_.residual,
                                     &samples_.weight,
                                     &samples_.time}) {
    values->resize(points_->size());
  }
  block_energies_.resize((points_->size() + kAlignmentBlock - 1) / kAlignmentBlock);
  forEachBlock([&](std::size_t number, const AlignmentBlock& block) {
    LaneEnergy sums;
    evaluateBlock(setting_, *points_, block, samples_, sums);
    block_energies_[number] = {sumLanes(sums.energy), sumOf(sums.used)};
  });
  Evaluation sum;
  for (const BlockEnergy& block : block_energies_) {
    sum.energy += static_cast<double>(block.energy);
    sum.used += block.used;
  }
  return sum;
}

template <int kParameters>
AlignmentEquations<kParameters> PoseAlignment::sumBlocks() {
  constexpr std::size_t kSums = triangleSums(kParameters);
  constexpr auto kAccumulate =
      kParameters == kRollingParameters ? accumulateRollingBlock : accumulateBlock;
  const std::size_t blocks = block_energies_.size();
  block_sums_.resize(blocks * kSums);
  forEachBlock([&](std::size_t number, const AlignmentBlock& block) {
    kAccumulate(setting_, *points_, samples_, block, block_sums_.data() + number * kSums);
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

/// One level for minimize().
class PoseAlignment::Problem {
 public:
  Problem(PoseAlignment& alignment, const AlignmentLevel& level, AlignmentState& state)
      : alignment_(alignment), level_(level), state_(state) {
    current_ = alignment.evaluate(level, state);
    if (level.rows != nullptr) {
      const double variance = kResidualsPerMeasurement * current_.meanEnergy();
      velocity_.emplace(*level.rows, variance);
    }
    prior_ = priorEnergy(state);
    linearize();
  }

  std::optional<double> solve(double lambda) {
    step_.head(b_.size()) = -solveDamped(H_, b_, lambda);
    if (lambda < kLambdaFloor) step_ *= std::pow(kLambdaFloor / lambda, 0.25);
    return step_.allFinite() ? std::optional(0.0) : std::nullopt;
  }

  std::optional<double> tryStep() {
    trial_state_ = state_.plus(step_);
    last_ = scaledNorm(step_) <= kStopNorm;
    if (last_) return 0;
    trial_ = alignment_.evaluate(level_, trial_state_);
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
  [[nodiscard]] PoseEquations equations() const { return withoutVelocity(H_, b_); }
  /// PoseAlignment::noise() of the current state.
  double noise() {
    if (refused_) (void)alignment_.evaluate(level_, state_);
    return alignment_.noise();
  }

 private:
  [[nodiscard]] double priorEnergy(const AlignmentState& state) const {
    return velocity_ ? velocity_->energy(state.T_cur_ref, state.motion.velocity) : 0;
  }
  void linearize() {
    if (velocity_) {
      RollingEquations equations = alignment_.rollingEquations();
      velocity_->addTo(state_.T_cur_ref, state_.motion.velocity, equations.H, equations.b);
      H_ = equations.H;
      b_ = equations.b;
    } else {
      const PoseEquations equations = alignment_.normalEquations();
      H_ = equations.H;
      b_ = equations.b;
    }
    if (alignment_.brightness_ != BrightnessModel::kPerfect) return;
    for (const Eigen::Index i : {6, 7}) {
      H_.row(i).setZero();
      H_.col(i).setZero();
      H_(i, i) = 1;
      b_[i] = 0;
    }
  }

  PoseAlignment& alignment_;
  const AlignmentLevel& level_;
  AlignmentState& state_;
  Evaluation current_;
  std::optional<VelocityTerm> velocity_;  // of a rolling shutter: an unknown then
  SmallMatrix H_;
  SmallVector b_;
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
  result.equations = problem.equations();
  return result;
}

double varianceOfResiduals(double rmse, double noise) {
  const double beyond_noise = std::max(0.0, rmse * rmse - noise * noise);
  return kResidualsPerNoise * (rmse * rmse - beyond_noise) + kResidualsPerMapError * beyond_noise;
}

std::optional<Matrix6d> trackingCovariance(const PoseEquations& equations,
                                           double variance,
                                           const SE3& T_cur_ref,
                                           BrightnessModel brightness) {
  const std::optional<Matrix6d> inverse =
      brightness == BrightnessModel::kPerfect
          ? inversePoseBlock<6>(equations.H.topLeftCorner<6, 6>())
          : inversePoseBlock<8>(equations.H);
  if (!inverse) return std::nullopt;
  Matrix6d covariance = variance * *inverse;
  const Eigen::Vector3d shared = variance_factors::kTrackedScale * T_cur_ref.translation();
  covariance.topLeftCorner<3, 3>() += shared * shared.transpose();
  covariance = (0.5 * (covariance + covariance.transpose())).eval();
  return covariance.allFinite() ? std::optional(covariance) : std::nullopt;
}

}  // namespace dsorb::track
