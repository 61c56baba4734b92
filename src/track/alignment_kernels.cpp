// SPDX-License-Identifier: BSD-3-Clause
#include "track/alignment_kernels.h"

#include "base/target_clones.h"
#include "estimate/robust_loss.h"
#include "estimate/sampling.h"

#include <cstring>
#include <limits>
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
  warpPoint(s.target.warp, ray_x, ray_y, rho, p);
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
  Lanes threshold;
  Lanes bound;
  fill(s.huber_threshold, threshold);
  fill(s.huber_threshold * (2.0F * s.cutoff - s.huber_threshold), bound);
  Lanes weight;
  huberWeights(magnitude, threshold, weight);
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

}  // namespace

DSORB_TARGET_CLONES
BlockEnergy evaluateBlock(const AlignmentSetting& setting,
                          const PointArrays& points,
                          const SampleArrays& samples,
                          std::size_t count) {
  LaneEnergy sums;
  const std::size_t whole = count / kLanes * kLanes;
  for (std::size_t i = 0; i < whole; i += kLanes) {
    evaluateLanes(setting, points, samples, {i, kLanes}, sums);
  }
  if (whole < count) evaluateLanes(setting, points, samples, {whole, count - whole}, sums);
  return {sumLanes(sums.energy), sumOf(sums.used), sumOf(sums.saturated)};
}

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

}  // namespace dsorb::track
