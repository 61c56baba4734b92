// SPDX-License-Identifier: BSD-3-Clause
#include "track/alignment_kernels.h"

#include "base/target_clones.h"
#include "estimate/robust_loss.h"
#include "estimate/sampling.h"

#include <cstring>
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
  unbendGradients<kRolling>(s.target, p, seen);
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
  Lanes energy;
  huberWeights(r, weight);
  huberEnergies(r, weight, energy);
  sums.energy += unsaturated ? energy : (used ? bound : zero);
  sums.used -= used;  // a lane that is true holds -1
  sums.saturated -= used & ~unsaturated;
  storeSome(p.u, count, samples.u + i);
  storeSome(p.v, count, samples.v + i);
  storeSome(rho * p.inverse_z, count, samples.rho + i);
  storeSome(seen.dx, count, samples.dx + i);
  storeSome(seen.dy, count, samples.dy + i);
  storeSome(unsaturated ? r : zero, count, samples.residual + i);
  storeSome(unsaturated ? weight : zero, count, samples.weight + i);
  if constexpr (kRolling) {
    Lanes time;
    rowTime(s.target.shutter, p.x, p.y, time);
    // The time of a point behind the camera may be no number, which no weight removes.
    storeSome(unsaturated ? time : zero, count, samples.time + i);
  }
}

int sumOf(const MaskOf<Lanes>& counts) {
  int sum = 0;
  for (int k = 0; k < kLanes; ++k) sum += counts[k];
  return sum;
}

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
BlockEnergy evaluateGlobalBlock(const AlignmentSetting& setting,
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
                                          const PointArrays& points,
                                          const SampleArrays& samples,
                                          std::size_t count,
                                          float* sums) {
  constexpr bool kRolling = kParameters == kRollingParameters;
  Columns<kParameters> columns;
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
    if constexpr (kRolling) {
      for (std::size_t k = 0; k < 6; ++k) J[8 + k][i] = samples.time[i] * by_pose[k];
    }
    J[kParameters][i] = samples.residual[i];
    weight[i] = samples.weight[i];
  }
  const std::size_t padded = (count + kLanes - 1) / kLanes * kLanes;
  for (std::size_t i = count; i < padded; ++i) {
    for (auto& column : J) column[i] = 0.0F;
    weight[i] = 0.0F;
  }
  accumulateRows(columns, weight, padded, sums, std::make_integer_sequence<int, kParameters>());
}

}  // namespace

BlockEnergy evaluateBlock(const AlignmentSetting& setting,
                          const PointArrays& points,
                          const SampleArrays& samples,
                          std::size_t count) {
  return setting.target.corrected ? evaluateRollingBlock(setting, points, samples, count)
                                  : evaluateGlobalBlock(setting, points, samples, count);
}

DSORB_TARGET_CLONES
void accumulateBlock(const AlignmentSetting& setting,
                     const PointArrays& points,
                     const SampleArrays& samples,
                     std::size_t count,
                     float* sums) {
  accumulatePoints<kAlignmentParameters>(setting, points, samples, count, sums);
}

DSORB_TARGET_CLONES
void accumulateRollingBlock(const AlignmentSetting& setting,
                            const PointArrays& points,
                            const SampleArrays& samples,
                            std::size_t count,
                            float* sums) {
  accumulatePoints<kRollingParameters>(setting, points, samples, count, sums);
}

}  // namespace dsorb::track
