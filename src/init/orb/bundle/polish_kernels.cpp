// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/bundle/polish_kernels.h"

#include "base/lanes.h"
#include "base/target_clones.h"
#include "estimate/robust_loss.h"
#include "estimate/sampling.h"

#include <cmath>

namespace dsorb::init_orb {
namespace {

constexpr int kRadius = kPolishSide / 2;

/// Offsets of the samples from the centre [px], and 1 for each; zeros fill up.
struct Offsets {
  std::array<float, kPolishLanes> x{};
  std::array<float, kPolishLanes> y{};
  std::array<float, kPolishLanes> used{};
};

constexpr Offsets makeOffsets() {
  Offsets offsets;
  for (std::size_t i = 0; i < kPolishPixels; ++i) {
    const int index = static_cast<int>(i);
    const int row = index / kPolishSide;
    offsets.x[i] = static_cast<float>(kPolishStep * (index - row * kPolishSide - kRadius));
    offsets.y[i] = static_cast<float>(kPolishStep * (row - kRadius));
    offsets.used[i] = 1;
  }
  return offsets;
}

constexpr Offsets kOffsets = makeOffsets();

DSORB_TARGET_CLONES bool linearizeInLanes(const TargetImage& target,
                                          const PolishPatch& patch,
                                          const PolishRay& ray,
                                          Lanes& totals) {
  Lanes terms[8] = {};
  const float step_x = 1.0F / target.warp.fx;
  const float step_y = 1.0F / target.warp.fy;
  SampleArea<Lanes> area;
  sampleArea(target.width, target.height, area);
  for (std::size_t i = 0; i < kPolishLanes; i += kLanes) {
    Lanes offset_x;
    Lanes offset_y;
    Lanes used;
    Lanes grey;
    load(&kOffsets.x[i], offset_x);
    load(&kOffsets.y[i], offset_y);
    load(&kOffsets.used[i], used);
    load(&patch.grey[i], grey);
    const Lanes ray_x = ray.x + step_x * offset_x;
    const Lanes ray_y = ray.y + step_y * offset_y;
    WarpedPoint<Lanes> point;
    warpPoint(target.warp, ray_x, ray_y, ray.inverse_depth, point);
    LaneSamples samples;
    MaskOf<Lanes> inside;
    sampleTarget(target, area, point, samples, inside);
    if (!inAllLanes(inside)) return false;
    const Lanes residual = (samples.intensity - target.gain * grey - target.offset) * used;
    const Lanes magnitude = residual < 0.0F ? -residual : residual;
    Lanes threshold;
    fill(kHuberThreshold, threshold);
    Lanes weight;
    huberWeights(magnitude, threshold, weight);
    weight *= used;
    const Lanes wx = weight * samples.dx;
    const Lanes wy = weight * samples.dy;
    terms[0] += wx * samples.dx;
    terms[1] += wx * samples.dy;
    terms[2] += wy * samples.dy;
    terms[3] += wx * residual;
    terms[4] += wy * residual;
    terms[5] += weight * residual * residual;
    terms[6] += weight;
    terms[7] += magnitude;
  }
  sumLanes(terms, totals);
  return true;
}

}  // namespace

PolishPatch cutPolishPatch(const PyramidLevel& reference, float x, float y) {
  PolishPatch patch;
  if (!canSample(reference, x, y, static_cast<float>(kPolishStep * kRadius))) {
    return patch;
  }
  float sum = 0;
  for (std::size_t i = 0; i < kPolishPixels; ++i) {
    patch.grey[i] = interpolateIntensity(reference, x + kOffsets.x[i], y + kOffsets.y[i]);
    sum += patch.grey[i];
  }
  patch.valid = std::isfinite(sum);
  return patch;
}

bool linearizePolish(const TargetImage& target,
                     const PolishPatch& patch,
                     const PolishRay& ray,
                     PolishSums& sums) {
  Lanes totals;
  if (!patch.valid || !linearizeInLanes(target, patch, ray, totals)) return false;
  sums = {totals[0], totals[1], totals[2], totals[3], totals[4], totals[5], totals[6], totals[7]};
  return std::isfinite(sums.magnitude);
}

}  // namespace dsorb::init_orb
