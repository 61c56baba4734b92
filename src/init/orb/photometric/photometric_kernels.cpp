// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/photometric/photometric_kernels.h"

#include "base/lanes.h"
#include "base/target_clones.h"
#include "estimate/robust_loss.h"
#include "estimate/sampling.h"

namespace dsorb::init_orb {
namespace {

using IntLanes = int __attribute__((vector_size(32)));

constexpr float kMinGreySum = 8;  // of a patch; psi of a darker one means nothing [grey levels]

/// The setting spread over lanes, once a run.
struct LaneSetting {
  Lanes offset_x;  // of the pattern, in rays
  Lanes offset_y;
  Lanes min, max_x, max_y;  // [px]
};

DSORB_ALWAYS_INLINE void spread(const PatchSetting& s, LaneSetting& lanes) {
  for (int k = 0; k < kLanes; ++k) {
    lanes.offset_x[k] = static_cast<float>(kPattern[static_cast<std::size_t>(k)].x) / s.fx;
    lanes.offset_y[k] = static_cast<float>(kPattern[static_cast<std::size_t>(k)].y) / s.fy;
  }
  fill(static_cast<float>(kNearBorder), lanes.min);
  fill(static_cast<float>(s.width - kFarBorder), lanes.max_x);
  fill(static_cast<float>(s.height - kFarBorder), lanes.max_y);
}

/// Residual, weight and derivatives of one patch: columns 0..5 pose, 6 and 7 brightness, 8 depth.
struct Patch {
  Lanes J[9];
  Lanes residual;
  Lanes weight;
  Lanes energy;
  IntLanes inside;
};

/// Projects, samples and differentiates, before brightness. @return intensities in `residual`
template <bool kPoses>
DSORB_ALWAYS_INLINE void projectPatch(
    const PatchSetting& s, const LaneSetting& lanes, const HostPatch& host, float rho, Patch& out) {
  const Lanes rx = host.ray.x() + lanes.offset_x;
  const Lanes ry = host.ray.y() + lanes.offset_y;
  const Lanes px = s.R[0] * rx + s.R[1] * ry + (s.R[2] + rho * s.t[0]);
  const Lanes py = s.R[3] * rx + s.R[4] * ry + (s.R[5] + rho * s.t[1]);
  const Lanes pz = s.R[6] * rx + s.R[7] * ry + (s.R[8] + rho * s.t[2]);
  Lanes min_z;
  fill(static_cast<float>(kMinPatchZ), min_z);
  const IntLanes front = pz > min_z;
  const Lanes inverse_z = 1.0F / (front ? pz : min_z);
  const Lanes u = px * inverse_z;
  const Lanes v = py * inverse_z;
  const Lanes x = s.fx * u + s.cx;
  const Lanes y = s.fy * v + s.cy;
  // Written so that NaN becomes the border, too.
  const Lanes low_x = x > lanes.min ? x : lanes.min;
  const Lanes low_y = y > lanes.min ? y : lanes.min;
  const Lanes clamped_x = low_x < lanes.max_x ? low_x : lanes.max_x;
  const Lanes clamped_y = low_y < lanes.max_y ? low_y : lanes.max_y;
  LaneSamples samples;
  interpolateLanes(s.image, s.width, clamped_x, clamped_y, samples);
  const IntLanes inside = front & (x == clamped_x) & (y == clamped_y);
  out.inside = inside & (samples.intensity == samples.intensity);  // not NaN
  Lanes zero;
  fill(0, zero);
  const Lanes gx = inside ? samples.dx * s.fx : zero;
  const Lanes gy = inside ? samples.dy * s.fy : zero;
  const Lanes radial = u * gx + v * gy;
  out.residual = samples.intensity;
  out.J[8] = inverse_z * (gx * s.t[0] + gy * s.t[1] - radial * s.t[2]);
  if constexpr (kPoses) {
    const Lanes scaled_rho = rho * inverse_z;
    out.J[0] = scaled_rho * gx;
    out.J[1] = scaled_rho * gy;
    out.J[2] = -scaled_rho * radial;
    out.J[3] = -gy - v * radial;
    out.J[4] = gx + u * radial;
    out.J[5] = u * gy - v * gx;
  }
}

template <PhotometricBrightness kModel>
DSORB_ALWAYS_INLINE void applyBrightness(const PatchSetting& s, const HostPatch& host, Patch& out) {
  Lanes grey;
  load(host.grey.data(), grey);
  if constexpr (kModel == PhotometricBrightness::kAffine) {
    out.J[6] = -s.gain * grey;
    fill(-1, out.J[7]);
    out.residual -= s.gain * grey + s.offset;
  } else {
    const float sum = sumLanes(grey);
    const Lanes share = grey / (sum > kMinGreySum ? sum : kMinGreySum);
    out.residual -= sumLanes(out.residual) * share;
  }
}

DSORB_ALWAYS_INLINE void weigh(const PatchSetting& s, const HostPatch& host, Patch& out) {
  Lanes zero;
  fill(0, zero);
  Lanes threshold;
  fill(s.huber_threshold, threshold);
  load(host.weight.data(), out.weight);
  const IntLanes valid = out.residual == out.residual;  // not NaN
  const Lanes r = valid ? out.residual : zero;
  const Lanes magnitude = r < zero ? -r : r;
  Lanes robust;
  huberWeights(magnitude, threshold, robust);
  out.residual = r;
  out.weight = valid ? out.weight * robust : zero;
  out.energy = out.weight * r * r * (2.0F - robust);
}

template <PhotometricBrightness kModel>
DSORB_ALWAYS_INLINE void addFrameSums(const Patch& patch, Lanes* totals) {
  constexpr int kSize = kModel == PhotometricBrightness::kAffine ? 8 : 6;
  int entry = 0;
  for (int i = 0; i < kSize; ++i) {
    const Lanes weighted = patch.weight * patch.J[i];
    for (int j = i; j < kSize; ++j) totals[entry++] += weighted * patch.J[j];
    totals[entry++] += weighted * patch.residual;
  }
}

template <PhotometricBrightness kModel, bool kPoses>
DSORB_ALWAYS_INLINE void addPatchSums(const Patch& patch, const PatchSums& sums, std::size_t i) {
  const Lanes weighted = patch.weight * patch.J[8];
  sums.energy[i] += sumLanes(patch.energy);
  if constexpr (!kPoses) {
    sums.depth_hessian[i] += sumLanes(weighted * patch.J[8]);
    sums.depth_gradient[i] += sumLanes(weighted * patch.residual);
    return;
  }
  float* coupling = sums.coupling + i * sums.stride;
  const Lanes hessian = weighted * patch.J[8];
  const Lanes gradient = weighted * patch.residual;
  constexpr bool kAffine = kModel == PhotometricBrightness::kAffine;
  const Lanes terms[8] = {weighted * patch.J[0],
                          weighted * patch.J[1],
                          weighted * patch.J[2],
                          weighted * patch.J[3],
                          weighted * patch.J[4],
                          weighted * patch.J[5],
                          kAffine ? weighted * patch.J[6] : hessian,
                          kAffine ? weighted * patch.J[7] : gradient};
  Lanes totals;
  sumLanes(terms, totals);
  for (int k = 0; k < 6; ++k) coupling[k] += totals[k];
  if constexpr (kAffine) {
    coupling[6] += totals[6];
    coupling[7] += totals[7];
    sums.depth_hessian[i] += sumLanes(hessian);
    sums.depth_gradient[i] += sumLanes(gradient);
  } else {
    sums.depth_hessian[i] += totals[6];
    sums.depth_gradient[i] += totals[7];
  }
}

template <PhotometricBrightness kModel, bool kPoses>
DSORB_ALWAYS_INLINE void linearizeRun(const PatchSetting& s,
                                      const PatchRun& run,
                                      const PatchSums& sums,
                                      Lanes* totals) {
  LaneSetting lanes;
  spread(s, lanes);
  for (std::size_t i = 0; i < run.count; ++i) {
    if (run.seen[i] == 0) continue;
    Patch patch;
    projectPatch<kPoses>(s, lanes, run.patches[i], run.inverse_depth[i], patch);
    applyBrightness<kModel>(s, run.patches[i], patch);
    weigh(s, run.patches[i], patch);
    if constexpr (kPoses) addFrameSums<kModel>(patch, totals);
    addPatchSums<kModel, kPoses>(patch, sums, i);
  }
}

template <PhotometricBrightness kModel>
DSORB_ALWAYS_INLINE void evaluateRun(const PatchSetting& s,
                                     const PatchRun& run,
                                     float* residual,
                                     char* inside) {
  LaneSetting lanes;
  spread(s, lanes);
  for (std::size_t i = 0; i < run.count; ++i) {
    if (run.seen != nullptr && run.seen[i] == 0) {
      inside[i] = 0;
      continue;
    }
    Patch patch;
    projectPatch<false>(s, lanes, run.patches[i], run.inverse_depth[i], patch);
    int all = -1;
    for (int k = 0; k < kLanes; ++k) all &= patch.inside[k];
    inside[i] = all != 0 ? 1 : 0;
    if (residual == nullptr) continue;
    applyBrightness<kModel>(s, run.patches[i], patch);
    store(patch.residual, residual + i * kLanes);
  }
}

template <bool kPoses>
DSORB_ALWAYS_INLINE void linearizeAs(const PatchSetting& s,
                                     const PatchRun& run,
                                     const PatchSums& sums,
                                     Lanes* totals) {
  switch (s.brightness) {
    case PhotometricBrightness::kPsiFixed:
      return linearizeRun<PhotometricBrightness::kPsiFixed, kPoses>(s, run, sums, totals);
    case PhotometricBrightness::kAffine:
      return linearizeRun<PhotometricBrightness::kAffine, kPoses>(s, run, sums, totals);
  }
}

DSORB_TARGET_CLONES void linearizeWithPoses(const PatchSetting& s,
                                            const PatchRun& run,
                                            const PatchSums& sums,
                                            Lanes* totals) {
  linearizeAs<true>(s, run, sums, totals);
}

DSORB_TARGET_CLONES void linearizeDepths(const PatchSetting& s,
                                         const PatchRun& run,
                                         const PatchSums& sums) {
  linearizeAs<false>(s, run, sums, nullptr);
}

DSORB_TARGET_CLONES void evaluateAs(const PatchSetting& s,
                                    const PatchRun& run,
                                    float* residual,
                                    char* inside) {
  switch (s.brightness) {
    case PhotometricBrightness::kPsiFixed:
      return evaluateRun<PhotometricBrightness::kPsiFixed>(s, run, residual, inside);
    case PhotometricBrightness::kAffine:
      return evaluateRun<PhotometricBrightness::kAffine>(s, run, residual, inside);
  }
}

}  // namespace

PatchSetting patchSetting(const PatchTarget& target,
                          PhotometricBrightness brightness,
                          double huber_threshold) {
  PatchSetting s{};
  const Eigen::Matrix3d R = target.T_cam_ref.rotationMatrix();
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) {
      const int entry = 3 * row + column;
      s.R[static_cast<std::size_t>(entry)] = static_cast<float>(R(row, column));
    }
    s.t[static_cast<std::size_t>(row)] = static_cast<float>(target.T_cam_ref.translation()[row]);
  }
  s.fx = static_cast<float>(target.camera->fx);
  s.fy = static_cast<float>(target.camera->fy);
  s.cx = static_cast<float>(target.camera->cx);
  s.cy = static_cast<float>(target.camera->cy);
  s.gain = static_cast<float>(target.transfer.gain);
  s.offset = static_cast<float>(target.transfer.offset);
  s.huber_threshold = static_cast<float>(huber_threshold);
  s.image = target.image->data();
  s.width = target.image->width();
  s.height = target.image->height();
  s.brightness = brightness;
  return s;
}

void linearizePatches(const PatchSetting& setting,
                      const PatchRun& run,
                      const PatchSums& sums,
                      std::array<float, kFrameSums>& frame) {
  if (sums.coupling == nullptr) {
    linearizeDepths(setting, run, sums);
    return;
  }
  Lanes totals[kFrameSums] = {};
  linearizeWithPoses(setting, run, sums, totals);
  for (std::size_t i = 0; i < kFrameSums; ++i) frame[i] += sumLanes(totals[i]);
}

void evaluatePatches(const PatchSetting& setting,
                     const PatchRun& run,
                     float* residual,
                     char* inside) {
  evaluateAs(setting, run, residual, inside);
}

DSORB_TARGET_CLONES void accumulateSchur(const EliminationRun& run, float* matrix, float* vector) {
  for (std::size_t i = 0; i < run.count; ++i) {
    const float* row = run.coupling + i * run.size;
    const float inverse = run.inverse[i];
    for (std::size_t r = 0; r < run.size; ++r) {
      const float factor = inverse * row[r];
      if (factor == 0) continue;
      float* target = matrix + r * run.size;
      vector[r] += factor * run.gradient[i];
      for (std::size_t c = r / kLanes * kLanes; c < run.size; c += kLanes) {
        Lanes sum;
        Lanes other;
        load(target + c, sum);
        load(row + c, other);
        sum += factor * other;
        store(sum, target + c);
      }
    }
  }
}

}  // namespace dsorb::init_orb
