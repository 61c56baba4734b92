// SPDX-License-Identifier: BSD-3-Clause
#include "init/coarse/coarse_residual.h"

#include "base/parallel.h"
#include "base/target_clones.h"
#include "estimate/host_patch.h"
#include "estimate/robust_loss.h"
#include "estimate/triangle_sums.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>

namespace dsorb::init_coarse {
namespace {

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
  WarpedPattern pattern;
  warpPattern(w.target, w.rays, pixel, inverse_depth, pattern);
  if (!inAllLanes(pattern.inside)) return HUGE_VALF;
  const WarpedPoint<Lanes>& p = pattern.at;
  const LaneSamples& seen = pattern.seen;
  Lanes reference;
  load(grey, reference);
  out.J[6] = -w.target.gain * reference;
  out.r = w.scale * (seen.intensity + out.J[6] - w.target.offset);
  out.J[6] = w.scale * out.J[6] - w.scale_rate * out.r;
  fill(-w.scale, out.J[7]);
  huberWeights(out.r, out.weight);
  RayGradient<Lanes> gradient;
  rayGradient<float, Lanes>(w.target.warp, p, w.scale * seen.dx, w.scale * seen.dy, gradient);
  poseJacobian<Lanes>(p, gradient, inverse_depth * p.inverse_z, out.J);
  Lanes flow_x;
  Lanes flow_y;
  depthFlow(w.target.warp, p, flow_x, flow_y);
  out.J_depth = w.scale * (seen.dx * flow_x + seen.dy * flow_y);
  out.squared_flow = flow_x * flow_x + flow_y * flow_y;
  Lanes energy;
  huberEnergies(out.r, out.weight, energy);
  return sumLanes(energy);
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
  Lanes coupling;
  sumLanes(products, coupling);
  store(coupling, &system.coupling[i * kParameters]);
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

}  // namespace

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

}  // namespace dsorb::init_coarse
