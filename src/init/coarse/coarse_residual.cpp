// SPDX-License-Identifier: BSD-3-Clause
#include "init/coarse/coarse_residual.h"

#include "base/parallel.h"
#include "base/target_clones.h"
#include "estimate/host_patch.h"
#include "estimate/robust_loss.h"

#include <algorithm>
#include <cmath>

namespace dsorb::init_coarse {
namespace {

constexpr std::size_t kBlock = 512;  // points a block of float sums has at most
constexpr std::size_t kParameters = 8;
constexpr int kTriangle = kParameters * (kParameters + 1) / 2;
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
                               alignment.T_new_ref,
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
                                        const HostedPoint& point,
                                        const float* grey,
                                        Residual& out) {
  WarpedPoint<Lanes> p;
  LaneSamples seen;
  if (!(point.inverse_depth > 0) || !samplePattern(w.target, w.rays, point, p, seen)) {
    return HUGE_VALF;
  }
  Lanes reference;
  Lanes threshold;
  load(grey, reference);
  fill(kHuberThreshold, threshold);
  out.J[6] = -w.target.gain * reference;
  out.r = w.scale * (seen.intensity + out.J[6] - w.target.offset);
  out.J[6] = w.scale * out.J[6] - w.scale_rate * out.r;
  fill(-w.scale, out.J[7]);
  const Lanes magnitude = out.r < 0.0F ? -out.r : out.r;
  huberWeights(magnitude, threshold, out.weight);
  RayGradient<Lanes> gradient;
  rayGradient<float, Lanes>(w.target.warp, p, w.scale * seen.dx, w.scale * seen.dy, gradient);
  poseJacobian<Lanes>(p, gradient, point.inverse_depth * p.inverse_z, out.J);
  Lanes flow_x;
  Lanes flow_y;
  depthFlow(w.target.warp, p, flow_x, flow_y);
  out.J_depth = w.scale * (seen.dx * flow_x + seen.dy * flow_y);
  out.squared_flow = flow_x * flow_x + flow_y * flow_y;
  return sumLanes(out.weight * out.r * out.r * (2.0F - out.weight));
}

/// Float sums of one block of points, a lane each for the pattern's pixels.
struct BlockSums {
  Lanes H[kTriangle];
  Lanes b[kParameters];
  LevelSums level;
};

DSORB_ALWAYS_INLINE void accumulate(const Residual& s, BlockSums& sums) {
  int entry = 0;
  for (std::size_t i = 0; i < kParameters; ++i) {
    const Lanes weighted = s.weight * s.J[i];
    for (std::size_t j = i; j < kParameters; ++j) sums.H[entry++] += weighted * s.J[j];
    sums.b[i] += weighted * s.r;
  }
}

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
      const HostedPoint point{points.x[i], points.y[i], points.trial_inverse_depth[i]};
      energy = evaluatePoint(w, point, &points.reference[i * kPatternSize], s);
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
    accumulate(s, sums);
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
  Matrix8d H = Matrix8d::Zero();  // upper triangle
  Vector8d b = Vector8d::Zero();
  LevelSums level;

  PartialSums() = default;
  explicit PartialSums(const BlockSums& sums) : level(sums.level) {
    const Lanes* entry = sums.H;
    for (Eigen::Index i = 0; i < H.rows(); ++i) {
      for (Eigen::Index j = i; j < H.cols(); ++j) H(i, j) = wideSum(*entry++);
      b[i] = wideSum(sums.b[i]);
    }
  }
  PartialSums& operator+=(const PartialSums& other) {
    H += other.H;
    b += other.b;
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
  system.H = total.H.selfadjointView<Eigen::Upper>();
  system.b = total.b;
  return total.level;
}

}  // namespace dsorb::init_coarse
