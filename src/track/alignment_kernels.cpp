// SPDX-License-Identifier: BSD-3-Clause
#include "track/alignment_kernels.h"

#include "base/target_clones.h"
#include "estimate/robust_loss.h"
#include "estimate/sampling.h"

#include <cmath>
#include <cstring>
#include <limits>

namespace dsorb::track {
namespace {

constexpr float kBorder = 2;  // [px]; a projection keeps further than this from the first pixel ...
constexpr float kFarBorder = 3;  // [px]; ... and from the number of pixels
constexpr float kSafePixel = 3;  // [px]; read in place of a projection outside the image

constexpr std::size_t kLanes = 8;
using FloatLanes = float __attribute__((vector_size(kLanes * sizeof(float))));

template <typename Vector>
inline __attribute__((always_inline)) void load(const float* from, Vector& to) {
  std::memcpy(&to, from, sizeof(Vector));
}

inline __attribute__((always_inline)) float horizontalSum(const FloatLanes& v) {
  return ((v[0] + v[4]) + (v[2] + v[6])) + ((v[1] + v[5]) + (v[3] + v[7]));
}

/// Columns of one block: Jacobian by the 8 parameters, then the residual.
struct Columns {
  alignas(32) float value[kAlignmentParameters + 1][kAlignmentBlock];
};

template <int kRow>
inline __attribute__((always_inline)) void accumulateRow(const Columns& columns,
                                                         const float* weight,
                                                         std::size_t padded,
                                                         float* sums) {
  constexpr int kTerms = kAlignmentParameters + 1 - kRow;
  FloatLanes total[kTerms] = {};
  for (std::size_t i = 0; i < padded; i += kLanes) {
    FloatLanes weighted;
    FloatLanes factor;
    load(weight + i, weighted);
    load(columns.value[kRow] + i, factor);
    weighted *= factor;
    for (int j = 0; j < kTerms; ++j) {
      load(columns.value[kRow + j] + i, factor);
      total[j] += weighted * factor;
    }
  }
  for (int j = 0; j < kTerms; ++j) sums[j] = horizontalSum(total[j]);
}

/// Values of one block that only live during its evaluation.
struct Scratch {
  alignas(32) float x[kAlignmentBlock];  // [px]
  alignas(32) float y[kAlignmentBlock];
  alignas(32) float intensity[kAlignmentBlock];
  alignas(32) float inside[kAlignmentBlock];  // 1 or 0
  alignas(32) float energy[kAlignmentBlock + kLanes];
};

inline __attribute__((always_inline)) void projectPoints(const AlignmentSetting& s,
                                                         const PointArrays& points,
                                                         const SampleArrays& samples,
                                                         std::size_t count,
                                                         Scratch& scratch) {
  const float max_x = static_cast<float>(s.width) - kFarBorder;
  const float max_y = static_cast<float>(s.height) - kFarBorder;
  for (std::size_t i = 0; i < count; ++i) {
    const float rx = points.ray_x[i];
    const float ry = points.ray_y[i];
    const float rho = points.inverse_depth[i];
    const float qx = s.R[0] * rx + s.R[1] * ry + s.R[2] + rho * s.t[0];
    const float qy = s.R[3] * rx + s.R[4] * ry + s.R[5] + rho * s.t[1];
    const float qz = s.R[6] * rx + s.R[7] * ry + s.R[8] + rho * s.t[2];
    const float inverse = 1.0F / qz;
    const float u = qx * inverse;
    const float v = qy * inverse;
    const float px = s.fx * u + s.cx;
    const float py = s.fy * v + s.cy;
    const float rho_frame = rho * inverse;
    const bool in =
        (rho_frame > 0.0F) & (px > kBorder) & (px < max_x) & (py > kBorder) & (py < max_y);
    samples.u[i] = in ? u : 0.0F;
    samples.v[i] = in ? v : 0.0F;
    samples.rho[i] = in ? rho_frame : 0.0F;
    scratch.x[i] = in ? px : kSafePixel;
    scratch.y[i] = in ? py : kSafePixel;
    scratch.inside[i] = in ? 1.0F : 0.0F;
  }
}

inline __attribute__((always_inline)) void sampleImage(const AlignmentSetting& s,
                                                       const SampleArrays& samples,
                                                       std::size_t count,
                                                       Scratch& scratch) {
  for (std::size_t i = 0; i < count; ++i) {
    SampleQuad value;
    interpolateQuad(s.image, s.width, scratch.x[i], scratch.y[i], value);
    scratch.intensity[i] = value[0];
    samples.dx[i] = value[1];
    samples.dy[i] = value[2];
  }
}

inline __attribute__((always_inline)) BlockEnergy weighResiduals(const AlignmentSetting& s,
                                                                 const PointArrays& points,
                                                                 const SampleArrays& samples,
                                                                 std::size_t count,
                                                                 Scratch& scratch) {
  const float saturated_energy =
      2.0F * s.huber_threshold * s.cutoff - s.huber_threshold * s.huber_threshold;
  int used_count = 0;
  int saturated_count = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const float r = scratch.intensity[i] - (s.gain * points.intensity[i] + s.offset);
    const float magnitude = std::abs(r);
    const bool used = (scratch.inside[i] > 0.0F) & (magnitude <= std::numeric_limits<float>::max());
    const bool unsaturated = used & (magnitude <= s.cutoff);
    const float w = huberWeight(r, s.huber_threshold);
    const float bounded = unsaturated ? huberEnergy(r, w) : saturated_energy;
    scratch.energy[i] = used ? bounded : 0.0F;
    samples.weight[i] = unsaturated ? w : 0.0F;
    samples.residual[i] = unsaturated ? r : 0.0F;
    used_count += used ? 1 : 0;
    saturated_count += (used & !unsaturated) ? 1 : 0;
  }
  std::memset(scratch.energy + count, 0, kLanes * sizeof(float));
  FloatLanes total = {};
  for (std::size_t i = 0; i < count; i += kLanes) {
    FloatLanes part;
    load(scratch.energy + i, part);
    total += part;
  }
  return {horizontalSum(total), used_count, saturated_count};
}

}  // namespace

DSORB_TARGET_CLONES
BlockEnergy evaluateBlock(const AlignmentSetting& setting,
                          const PointArrays& points,
                          const SampleArrays& samples,
                          std::size_t count) {
  Scratch scratch;
  projectPoints(setting, points, samples, count, scratch);
  sampleImage(setting, samples, count, scratch);
  return weighResiduals(setting, points, samples, count, scratch);
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
  const float fx = setting.fx;
  const float fy = setting.fy;
  const float gain = setting.gain;
  const float b_reference = setting.affine_b_reference;
  for (std::size_t i = 0; i < count; ++i) {
    const float u = samples.u[i];
    const float v = samples.v[i];
    const float rho = samples.rho[i];
    const float gx = fx * samples.dx[i];
    const float gy = fy * samples.dy[i];
    const float radial = u * gx + v * gy;
    J[0][i] = rho * gx;
    J[1][i] = rho * gy;
    J[2][i] = -rho * radial;
    J[3][i] = -v * radial - gy;
    J[4][i] = u * radial + gx;
    J[5][i] = u * gy - v * gx;
    J[6][i] = gain * (b_reference - points.intensity[i]);
    J[7][i] = -1.0F;
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
