// SPDX-License-Identifier: BSD-3-Clause
#include "init/coarse/coarse_residual.h"

#include "base/lanes.h"
#include "base/parallel.h"
#include "base/target_clones.h"
#include "estimate/robust_loss.h"
#include "estimate/sampling.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace dsorb::init_coarse {
namespace {

constexpr std::size_t kBlock = 512;  // points a block of float sums has at most
constexpr int kParameters = 8;
constexpr int kTriangle = kParameters * (kParameters + 1) / 2;
constexpr float kMaxInverseStep = 1e-10F;  // of the step limit, against division by zero

using Mask = std::int32_t __attribute__((vector_size(32)));

/// Everything the loop over points reads that is the same for all of them.
struct Constants {
  const ImageSample* samples;
  std::ptrdiff_t width;
  float limit_x, limit_y;  // projections stay below
  float fx, fy, cx, cy;
  float RKi[9];  // pixel of the reference to ray in the new camera
  float t[3];
  float gain, offset;
  float scale;       // of residuals
  float scale_rate;  // half where the scale follows the gain
  DepthTerms terms;
};

Constants makeConstants(const LevelView& view,
                        const Alignment& alignment,
                        const DepthTerms& terms) {
  Constants c{};
  c.samples = view.image->data();
  c.width = view.image->width();
  c.limit_x = static_cast<float>(view.image->width() - 2);
  c.limit_y = static_cast<float>(view.image->height() - 2);
  c.fx = static_cast<float>(view.camera.fx);
  c.fy = static_cast<float>(view.camera.fy);
  c.cx = static_cast<float>(view.camera.cx);
  c.cy = static_cast<float>(view.camera.cy);
  const Eigen::Matrix3d RKi = alignment.T_new_ref.rotationMatrix() * view.camera.matrix().inverse();
  for (int i = 0; i < 9; ++i) c.RKi[i] = static_cast<float>(RKi(i / 3, i % 3));
  for (int i = 0; i < 3; ++i) c.t[i] = static_cast<float>(alignment.T_new_ref.translation()[i]);
  c.gain = static_cast<float>(std::exp(alignment.log_gain));
  c.offset = static_cast<float>(alignment.offset);
  const double log_scale = 0.5 * (alignment.exposure_log_gain - alignment.log_gain);
  c.scale = alignment.balanced ? static_cast<float>(std::exp(log_scale)) : 1.0F;
  c.scale_rate = alignment.balanced ? 0.5F : 0.0F;
  c.terms = terms;
  return c;
}

/// The pattern of one point in the new image.
struct Projection {
  Lanes u, v;       // ray, z = 1
  Lanes inverse_z;  // [1/unit] times the reference's z
  Lanes x, y;       // [px]
};

DSORB_ALWAYS_INLINE bool project(const Constants& c, float x, float y, float depth, Projection& p) {
  const Lanes px = x + kPatternX;
  const Lanes py = y + kPatternY;
  const Lanes qx = c.RKi[0] * px + c.RKi[1] * py + (c.RKi[2] + depth * c.t[0]);
  const Lanes qy = c.RKi[3] * px + c.RKi[4] * py + (c.RKi[5] + depth * c.t[1]);
  const Lanes qz = c.RKi[6] * px + c.RKi[7] * py + (c.RKi[8] + depth * c.t[2]);
  p.inverse_z = 1.0F / qz;
  p.u = qx * p.inverse_z;
  p.v = qy * p.inverse_z;
  p.x = c.fx * p.u + c.cx;
  p.y = c.fy * p.v + c.cy;
  const Mask inside = (p.x > 1.0F) & (p.x < c.limit_x) & (p.y > 1.0F) & (p.y < c.limit_y) &
                      (depth * p.inverse_z > 0.0F);
  std::int32_t all = -1;
  for (int i = 0; i < kLanes; ++i) all &= inside[i];
  return all != 0;
}

/// Residuals of one point with their derivatives.
struct Residual {
  Lanes r, weight;
  Lanes J[kParameters];
  Lanes J_depth;
  Lanes squared_flow;  // of the projection over the inverse depth [px^2]
};

DSORB_ALWAYS_INLINE void differentiate(
    const Constants& c, const Projection& p, float depth, const LaneSamples& seen, Residual& out) {
  const Lanes gx = (c.scale * c.fx) * seen.dx;
  const Lanes gy = (c.scale * c.fy) * seen.dy;
  const Lanes new_depth = depth * p.inverse_z;
  const Lanes uv = p.u * p.v;
  out.J[0] = new_depth * gx;
  out.J[1] = new_depth * gy;
  out.J[2] = -new_depth * (p.u * gx + p.v * gy);
  out.J[3] = -uv * gx - (1.0F + p.v * p.v) * gy;
  out.J[4] = (1.0F + p.u * p.u) * gx + uv * gy;
  out.J[5] = p.u * gy - p.v * gx;
  fill(-c.scale, out.J[7]);
  const Lanes du = (c.t[0] - c.t[2] * p.u) * p.inverse_z;
  const Lanes dv = (c.t[1] - c.t[2] * p.v) * p.inverse_z;
  out.J_depth = gx * du + gy * dv;
  out.squared_flow = (c.fx * c.fx) * du * du + (c.fy * c.fy) * dv * dv;
}

/// Float sums of one block of points; a lane each for the pattern's pixels, except `schur`, whose
/// lanes are parameters.
struct BlockSums {
  Lanes H[kTriangle];
  Lanes b[kParameters];
  Lanes schur[kParameters];
  Lanes schur_b;
  double energy = 0;
  double good_energy = 0;
  int good = 0;
  int inliers = 0;
};

DSORB_ALWAYS_INLINE void accumulate(const Residual& s, BlockSums& sums) {
  int entry = 0;
  for (int i = 0; i < kParameters; ++i) {
    const Lanes weighted = s.weight * s.J[i];
    for (int j = i; j < kParameters; ++j) sums.H[entry++] += weighted * s.J[j];
    sums.b[i] += weighted * s.r;
  }
}

struct Depth {
  float value, smoothed;
};

/// Coupling, gradient and curvature of one inverse depth, and its share of the Schur complement.
/// @return photometric curvature
DSORB_ALWAYS_INLINE float accumulateDepth(
    const Constants& c, const Residual& s, const Depth& depth, float* schur_row, BlockSums& sums) {
  Lanes products[kParameters];
  const Lanes weighted = s.weight * s.J_depth;
  for (int i = 0; i < kParameters; ++i) products[i] = weighted * s.J[i];
  Lanes h;
  sumLanes(products, h);
  const float curvature = sumLanes(weighted * s.J_depth);
  const float gradient = sumLanes(weighted * s.r) + c.terms.prior * (depth.value - 1.0F) +
                         c.terms.coupling * (depth.value - depth.smoothed);
  const float inverse = 1.0F / (1.0F + curvature + c.terms.prior + c.terms.coupling);
  for (int i = 0; i < kParameters; ++i) sums.schur[i] += (inverse * h[i]) * h;
  sums.schur_b += (inverse * gradient) * h;
  store(h, schur_row);
  schur_row[kParameters] = gradient;
  schur_row[kParameters + 1] = inverse;
  return curvature;
}

/// Points [begin, end).
struct Block {
  std::size_t begin, end;
};

DSORB_TARGET_CLONES void evaluateBlock(const Constants& c,
                                       const Block& block,
                                       PointLevel& points,
                                       SchurTerms& schur,
                                       BlockSums& sums) {
  Lanes threshold;
  fill(kHuberThreshold, threshold);
  for (std::size_t i = block.begin; i < block.end; ++i) {
    points.trial_good[i] = 0;
    points.trial_energy[i] = points.energy[i];
    Projection p;
    const float depth = points.trial_inverse_depth[i];
    Residual s;
    float energy = HUGE_VALF;
    if (points.good[i] != 0 && project(c, points.x[i], points.y[i], depth, p)) {
      LaneSamples seen;
      Lanes reference;
      interpolateLanes(c.samples, c.width, p.x, p.y, seen);
      load(&points.reference[i * kPatternSize], reference);
      s.J[6] = -c.gain * reference;
      s.r = c.scale * (seen.intensity + s.J[6] - c.offset);
      s.J[6] = c.scale * s.J[6] - c.scale_rate * s.r;
      const Lanes magnitude = s.r < 0.0F ? -s.r : s.r;
      huberWeights(magnitude, threshold, s.weight);
      energy = sumLanes(s.weight * s.r * s.r * (2.0F - s.weight));
      differentiate(c, p, depth, seen, s);
    }
    if (!(energy <= kMaxPatternEnergy)) {
      sums.energy += static_cast<double>(points.energy[i]);
      continue;
    }
    float row[kParameters + 2];
    points.trial_good[i] = 1;
    points.trial_energy[i] = energy;
    points.trial_curvature[i] = accumulateDepth(c, s, {depth, points.smoothed[i]}, row, sums);
    float flow = kMaxInverseStep * kMaxInverseStep;
    for (int k = 0; k < kLanes; ++k) flow = std::max(flow, s.squared_flow[k]);
    points.max_step[i] = 1.0F / std::sqrt(flow);
    std::memcpy(&schur.coupling[i * kParameters], row, kParameters * sizeof(float));
    schur.gradient[i] = row[kParameters];
    schur.inverse_curvature[i] = row[kParameters + 1];
    accumulate(s, sums);
    sums.energy += static_cast<double>(energy);
    sums.good_energy += static_cast<double>(energy);
    ++sums.good;
    sums.inliers += energy <= kPatternOutlierEnergy ? 1 : 0;
  }
}

double wideSum(const Lanes& lanes) {
  double sum = 0;
  for (int i = 0; i < kLanes; ++i) sum += static_cast<double>(lanes[i]);
  return sum;
}

void addTo(const BlockSums& sums, NormalEquations& equations) {
  int entry = 0;
  for (int i = 0; i < kParameters; ++i) {
    for (int j = i; j < kParameters; ++j) {
      const double value = wideSum(sums.H[entry++]);
      equations.H(i, j) += value;
      if (i != j) equations.H(j, i) += value;
    }
    equations.b[i] += wideSum(sums.b[i]);
    for (int j = 0; j < kParameters; ++j) {
      equations.H_schur(i, j) += static_cast<double>(sums.schur[std::min(i, j)][std::max(i, j)]);
    }
    equations.b_schur[i] += static_cast<double>(sums.schur_b[i]);
  }
  equations.energy += sums.energy;
  equations.good_energy += sums.good_energy;
  equations.good += sums.good;
  equations.inliers += sums.inliers;
}

}  // namespace

void SchurTerms::resize(std::size_t points) {
  coupling.resize(points * kParameters);
  gradient.resize(points);
  inverse_curvature.resize(points);
}

NormalEquations& NormalEquations::operator+=(const NormalEquations& other) {
  H += other.H;
  b += other.b;
  H_schur += other.H_schur;
  b_schur += other.b_schur;
  energy += other.energy;
  good_energy += other.good_energy;
  good += other.good;
  inliers += other.inliers;
  return *this;
}

NormalEquations evaluateLevel(const LevelView& view,
                              const Alignment& alignment,
                              const DepthTerms& terms,
                              PointLevel& points,
                              SchurTerms& schur) {
  const Constants constants = makeConstants(view, alignment, terms);
  schur.resize(points.x.size());
  return deterministicSum(points.x.size(),
                          kBlock,
                          NormalEquations{},
                          [&](std::size_t begin, std::size_t end, NormalEquations partial) {
                            BlockSums sums{};
                            evaluateBlock(constants, {begin, end}, points, schur, sums);
                            addTo(sums, partial);
                            return partial;
                          });
}

}  // namespace dsorb::init_coarse
