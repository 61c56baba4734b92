// SPDX-License-Identifier: BSD-3-Clause
#include "init/coarse/coarse_alignment.h"

#include "base/median.h"
#include "base/parallel.h"
#include "base/target_clones.h"
#include "estimate/host_patch.h"
#include "estimate/levenberg_marquardt.h"
#include "estimate/robust_loss.h"
#include "estimate/triangle_sums.h"
#include "image/cell_grid.h"

#include <Eigen/Cholesky>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <optional>
#include <utility>

namespace dsorb::init_coarse {
namespace {

constexpr std::array<double, 5> kDensities = {0.03, 0.05, 0.15, 0.5, 1.0};  // of level 0's pixels
constexpr int kMinGoodNeighbours = 3;
constexpr double kPointsPerCell = 3;

PointGrid gridOf(const PointLevel& level) {
  std::vector<Eigen::Vector2f> points;
  for (std::size_t i = 0; i < level.x.size(); ++i) points.emplace_back(level.x[i], level.y[i]);
  const float width = *std::max_element(level.x.begin(), level.x.end()) + 1;
  const float height = *std::max_element(level.y.begin(), level.y.end()) + 1;
  const double cell = std::sqrt(width * height * kPointsPerCell / level.size());
  return {std::move(points), CellGrid(static_cast<int>(width), static_cast<int>(height), cell)};
}

void findNeighbours(PointLevel& level) {
  const PointGrid grid = gridOf(level);
  level.neighbours.assign(level.x.size() * kNeighbours, -1);
  for (std::size_t i = 0; i < level.x.size(); ++i) {
    std::int32_t* next = &level.neighbours[i * kNeighbours];
    for (const auto& found : grid.nearest<kNeighbours>({level.x[i], level.y[i]}, HUGE_VALF)) {
      *next++ = static_cast<std::int32_t>(found.point);
    }
  }
}

/// Element count / 2 of the sorted values, count at least 1; reorders them.
float upperMedian(float* values, int count) {
  std::nth_element(values, values + count / 2, values + count);
  return values[count / 2];
}

/// Calls f with the positions of the good neighbours of a point, the nearest first.
template <typename F>
void forEachGoodNeighbour(const PointLevel& level, std::size_t point, F f) {
  for (std::size_t n = 0; n < kNeighbours; ++n) {
    const std::int32_t other = level.neighbours[point * kNeighbours + n];
    if (other < 0) break;
    const auto neighbour = static_cast<std::size_t>(other);
    if (level.good[neighbour] != 0) f(neighbour);
  }
}

constexpr std::size_t kBlock = 512;  // points a block of float sums has at most
constexpr std::size_t kParameters = 8;
constexpr float kMaxInverseStep = 1e-10F;  // of the step limit, against division by zero

/// Everything the loop over points reads that is the same for all of them.
struct LevelWarp {
  TargetImage target;
  HostRays rays;
  float scale = 1;   // of residuals
  float scale_rate;  // half where the scale follows the gain
  DepthPull pull;

  LevelWarp(const LevelView& view, const Alignment& alignment, const DepthPull& depth_pull)
      : target(makeTargetImage(view.camera,
                               alignment.T_cur_ref,
                               {std::exp(alignment.log_gain), alignment.offset},
                               *view.image)),
        rays(view.camera),
        scale_rate(alignment.balanced ? 0.5F : 0.0F),
        pull(depth_pull) {
    const double log_scale = 0.5 * (alignment.exposure_log_gain - alignment.log_gain);
    if (alignment.balanced) scale = static_cast<float>(std::exp(log_scale));
  }
};

/// Residuals of one point with their derivatives.
struct Residual {
  Lanes r, weight;
  Lanes J[kParameters];
  Lanes J_depth;
  Lanes squared_flow;  // of the projection over the inverse depth [px^2]
};

/// @return energy, infinite for a point that is not seen
DSORB_ALWAYS_INLINE float evaluatePoint(const LevelWarp& w,
                                        const Eigen::Vector2f& pixel,
                                        float inverse_depth,
                                        const float* grey,
                                        Residual& out) {
  if (!(inverse_depth > 0)) return HUGE_VALF;
  const WarpedPattern pattern = warpPattern(w.target, w.rays, pixel, inverse_depth);
  if (!inAllLanes(pattern.inside)) return HUGE_VALF;
  const WarpedPoint<Lanes>& p = pattern.at;
  const LaneSamples& seen = pattern.seen;
  out.J[6] = -w.target.gain * load(grey);
  out.r = w.scale * (seen.intensity + out.J[6] - w.target.offset);
  out.J[6] = w.scale * out.J[6] - w.scale_rate * out.r;
  out.J[7] = spread<Lanes>(-w.scale);
  out.weight = huberWeights(out.r);
  const auto gradient =
      rayGradient<float, Lanes>(w.target.warp, p, w.scale * seen.dx, w.scale * seen.dy);
  poseJacobian<Lanes>(p, gradient, inverse_depth * p.inverse_z, out.J);
  const DepthFlow<Lanes> flow = depthFlow(w.target.warp, p);
  out.J_depth = w.scale * (seen.dx * flow.x + seen.dy * flow.y);
  out.squared_flow = flow.x * flow.x + flow.y * flow.y;
  return sumLanes(huberEnergies(out.r, out.weight));
}

/// Float sums of one block of points, a lane each for the pattern's pixels.
struct BlockSums {
  Lanes triangle[triangleSums(kParameters)];
  LevelSums level;
};

/// Writes the row of one inverse depth.
DSORB_ALWAYS_INLINE void couple(const LevelWarp& w,
                                const Residual& s,
                                std::size_t i,
                                PointLevel& points,
                                LinearSystem<float>& system) {
  Lanes products[kParameters];
  const Lanes weighted = s.weight * s.J_depth;
  for (std::size_t k = 0; k < kParameters; ++k) products[k] = weighted * s.J[k];
  store(sumLanes(products), &system.coupling[i * kParameters]);
  const float depth = points.trial_inverse_depth[i];
  const float curvature = sumLanes(weighted * s.J_depth);
  points.trial_curvature[i] = curvature;
  system.depth_hessian[i] = 1.0F + curvature + w.pull.prior + w.pull.coupling;
  system.depth_gradient[i] = sumLanes(weighted * s.r) + w.pull.prior * (depth - 1.0F) +
                             w.pull.coupling * (depth - points.smoothed[i]);
}

/// Points [begin, end).
struct Block {
  std::size_t begin, end;
};

DSORB_TARGET_CLONES void evaluateBlock(const LevelWarp& w,
                                       const Block& block,
                                       PointLevel& points,
                                       LinearSystem<float>& system,
                                       BlockSums& sums) {
  for (std::size_t i = block.begin; i < block.end; ++i) {
    points.trial_good[i] = 0;
    points.trial_energy[i] = points.energy[i];
    Residual s;
    float energy = HUGE_VALF;
    if (points.good[i] != 0) {
      energy = evaluatePoint(w,
                             {points.x[i], points.y[i]},
                             points.trial_inverse_depth[i],
                             &points.reference[i * kPatternSize],
                             s);
    }
    if (!(energy <= kMaxPatternEnergy)) {
      sums.level.energy += static_cast<double>(points.energy[i]);
      continue;
    }
    points.trial_good[i] = 1;
    points.trial_energy[i] = energy;
    couple(w, s, i, points, system);
    float flow = kMaxInverseStep * kMaxInverseStep;
    for (int k = 0; k < kLanes; ++k) flow = std::max(flow, s.squared_flow[k]);
    points.max_step[i] = 1.0F / std::sqrt(flow);
    addToTriangle<kParameters>(s.J, s.weight, s.r, sums.triangle);
    sums.level.energy += static_cast<double>(energy);
    sums.level.good_energy += static_cast<double>(energy);
    ++sums.level.good;
    sums.level.inliers += energy <= kPatternOutlierEnergy ? 1 : 0;
  }
}

double wideSum(const Lanes& lanes) {
  double sum = 0;
  for (int i = 0; i < kLanes; ++i) sum += static_cast<double>(lanes[i]);
  return sum;
}

/// Sums of some blocks.
struct PartialSums {
  std::array<double, triangleSums(kParameters)> triangle{};
  LevelSums level;

  PartialSums() = default;
  explicit PartialSums(const BlockSums& sums) : level(sums.level) {
    std::transform(std::begin(sums.triangle), std::end(sums.triangle), triangle.begin(), wideSum);
  }
  PartialSums& operator+=(const PartialSums& other) {
    for (std::size_t i = 0; i < triangle.size(); ++i) triangle[i] += other.triangle[i];
    level += other.level;
    return *this;
  }
};

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

int wantedPoints(int level, int width, int height) {
  const std::size_t index = std::min(static_cast<std::size_t>(level), kDensities.size() - 1);
  return std::max(1, static_cast<int>(std::lround(kDensities[index] * width * height)));
}

PointLevel makePointLevel(const PyramidLevel& image, const std::vector<SelectedPixel>& pixels) {
  PointLevel level;
  for (const SelectedPixel& pixel : pixels) {
    const float x = static_cast<float>(pixel.x) + kPixelOffset;
    const float y = static_cast<float>(pixel.y) + kPixelOffset;
    const auto patch = readHostPatch<interpolate<float>>(image, {x, y});
    if (!patch) continue;
    level.x.push_back(x);
    level.y.push_back(y);
    level.reference.insert(level.reference.end(), patch->grey.begin(), patch->grey.end());
  }
  const std::size_t n = level.x.size();
  level.parent.assign(n, -1);
  for (auto* depths : {&level.inverse_depth, &level.trial_inverse_depth, &level.smoothed}) {
    depths->assign(n, 1.0F);
  }
  for (auto* zeros : {&level.energy,
                      &level.trial_energy,
                      &level.curvature,
                      &level.trial_curvature,
                      &level.max_step}) {
    zeros->assign(n, 0.0F);
  }
  level.good.assign(n, 1);
  level.trial_good.assign(n, 1);
  if (n > 0) findNeighbours(level);
  return level;
}

void findParents(const PointLevel& coarse, double max_distance, PointLevel& fine) {
  if (coarse.size() == 0) return;
  const PointGrid grid = gridOf(coarse);
  const float limit = max_distance > 0 ? static_cast<float>(max_distance) : HUGE_VALF;
  for (std::size_t i = 0; i < fine.x.size(); ++i) {
    // Pixel centres of 2 x 2 means.
    const auto found = grid.nearest<1>({0.5F * fine.x[i] - 0.25F, 0.5F * fine.y[i] - 0.25F}, limit);
    fine.parent[i] = found.count > 0 ? static_cast<std::int32_t>(found.nearest[0].point) : -1;
  }
}

void flatten(PointLevel& level) {
  for (auto* depths : {&level.inverse_depth, &level.trial_inverse_depth, &level.smoothed}) {
    std::fill(depths->begin(), depths->end(), 1.0F);
  }
  std::fill(level.curvature.begin(), level.curvature.end(), 0.0F);
}

void smooth(PointLevel& level) {
  std::array<float, kNeighbours> values{};
  for (std::size_t i = 0; i < level.x.size(); ++i) {
    if (level.good[i] == 0) continue;
    int count = 0;
    forEachGoodNeighbour(level, i, [&](std::size_t neighbour) {
      values[static_cast<std::size_t>(count++)] = level.smoothed[neighbour];
    });
    if (count < kMinGoodNeighbours) continue;
    level.smoothed[i] = (1.0F - kSmoothingWeight) * level.inverse_depth[i] +
                        kSmoothingWeight * upperMedian(values.data(), count);
  }
}

float neighbourSpread(const PointLevel& level, std::size_t point) {
  std::array<float, kNeighbours> off{};
  int count = 0;
  forEachGoodNeighbour(level, point, [&](std::size_t neighbour) {
    off[static_cast<std::size_t>(count++)] =
        std::abs(level.inverse_depth[neighbour] - level.smoothed[point]);
  });
  if (count < kMinGoodNeighbours) return 0;
  return static_cast<float>(kMadToSigma) * upperMedian(off.data(), count);
}

void propagateDown(const PointLevel& coarse, PointLevel& fine) {
  for (std::size_t i = 0; i < fine.x.size(); ++i) {
    if (fine.parent[i] < 0) continue;
    const auto parent = static_cast<std::size_t>(fine.parent[i]);
    const float weight = coarse.curvature[parent];
    if (coarse.good[parent] == 0 || weight < kMinParentCurvature) continue;
    float depth = coarse.smoothed[parent];
    if (fine.good[i] == 0) {
      fine.good[i] = 1;
      fine.curvature[i] = 0;
    } else {
      const float own = 2.0F * fine.curvature[i];
      depth = (own * fine.smoothed[i] + weight * depth) / (own + weight);
    }
    fine.smoothed[i] = fine.inverse_depth[i] = fine.trial_inverse_depth[i] = depth;
  }
}

void propagateUp(const PointLevel& fine, bool keep_orphans, PointLevel& coarse) {
  std::vector<float> sums(coarse.x.size(), 0.0F);
  std::vector<float> weights(coarse.x.size(), 0.0F);
  for (std::size_t i = 0; i < fine.x.size(); ++i) {
    if (fine.good[i] == 0 || fine.parent[i] < 0) continue;
    const auto parent = static_cast<std::size_t>(fine.parent[i]);
    sums[parent] += fine.curvature[i] * fine.smoothed[i];
    weights[parent] += fine.curvature[i];
  }
  for (std::size_t p = 0; p < coarse.x.size(); ++p) {
    if (weights[p] > 0) {
      coarse.smoothed[p] = coarse.inverse_depth[p] = sums[p] / weights[p];
      coarse.good[p] = 1;
    } else if (!keep_orphans) {
      coarse.smoothed[p] = 0;
    }
  }
}

void reviveFromNeighbours(PointLevel& level) {
  for (std::size_t i = 0; i < level.x.size(); ++i) {
    if (level.good[i] != 0) continue;
    float sum = 0;
    int count = 0;
    forEachGoodNeighbour(level, i, [&](std::size_t neighbour) {
      sum += level.smoothed[neighbour];
      ++count;
    });
    if (count == 0) continue;
    level.good[i] = 1;
    level.smoothed[i] = level.inverse_depth[i] = level.trial_inverse_depth[i] =
        sum / static_cast<float>(count);
  }
}

LevelSums& LevelSums::operator+=(const LevelSums& other) {
  energy += other.energy;
  good_energy += other.good_energy;
  good += other.good;
  inliers += other.inliers;
  return *this;
}

LevelSums evaluateLevel(const LevelView& view,
                        const Alignment& alignment,
                        const DepthPull& pull,
                        PointLevel& points,
                        LinearSystem<float>& system) {
  const LevelWarp warp(view, alignment, pull);
  system.reset(kParameters, points.x.size());
  const PartialSums total =
      deterministicSum(points.x.size(),
                       kBlock,
                       PartialSums(),
                       [&](std::size_t begin, std::size_t end, const PartialSums& /*zero*/) {
                         BlockSums sums{};
                         evaluateBlock(warp, {begin, end}, points, system, sums);
                         return PartialSums(sums);
                       });
  addTriangle(total.triangle.data(), 0, kParameters, system.H, system.b);
  system.H.triangularView<Eigen::StrictlyLower>() = system.H.transpose();
  return total.level;
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
  const int first = unknowns == Unknowns::kRotation ? 3 : 0;
  const int size = (options_.published ? 6 : 8) - first;
  Eigen::MatrixXd H = accepted_.H;
  Eigen::VectorXd b = accepted_.b;
  H.diagonal() *= 1.0 + damping;
  if (unknowns == Unknowns::kAll) {
    elimination_.damp(accepted_, damping);
    elimination_.eliminate(accepted_, H, b);
  }
  Vector8d step = Vector8d::Zero();
  step.segment(first, size) =
      -H.block(first, first, size, size).ldlt().solve(b.segment(first, size));
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
