// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/photometric/photometric_kernels.h"

#include "base/lanes.h"
#include "base/target_clones.h"
#include "estimate/robust_loss.h"
#include "estimate/sampling.h"

namespace dsorb::init_orb {
namespace {

using IntLanes = MaskOf<Lanes>;

constexpr float kMinGreySum = 8;  // of a patch; psi of a darker one means nothing [grey levels]

/// What all patches of a run share, spread over lanes.
struct LaneSetting {
  Lanes offset_x;  // of the pattern, in rays
  Lanes offset_y;
  SampleArea<Lanes> area;
};

DSORB_ALWAYS_INLINE void spreadPattern(const TargetImage& target, LaneSetting& lanes) {
  lanes.offset_x = kPatternX / target.warp.fx;
  lanes.offset_y = kPatternY / target.warp.fy;
  sampleArea(target.width, target.height, lanes.area);
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
DSORB_ALWAYS_INLINE void projectPatch(const TargetImage& target,
                                      const LaneSetting& lanes,
                                      const HostPatch& host,
                                      float rho,
                                      Patch& out) {
  const Lanes ray_x = host.ray.x() + lanes.offset_x;
  const Lanes ray_y = host.ray.y() + lanes.offset_y;
  const Warp<float>& warp = target.warp;
  WarpedPoint<Lanes> point;
  warpPoint(warp, ray_x, ray_y, rho, point);
  LaneSamples samples;
  IntLanes inside;
  sampleTarget(target, lanes.area, point, samples, inside);
  out.inside = inside & (samples.intensity == samples.intensity);  // not NaN
  out.residual = samples.intensity;
  Lanes zero;
  fill(0, zero);
  const Lanes dx = inside ? samples.dx : zero;
  const Lanes dy = inside ? samples.dy : zero;
  RayGradient<Lanes> gradient;
  rayGradient(warp, point, dx, dy, gradient);
  depthJacobian(warp, point, gradient, out.J[8]);
  if constexpr (kPoses) poseJacobian(point, gradient, rho * point.inverse_z, out.J);
}

template <PhotometricBrightness kModel>
DSORB_ALWAYS_INLINE void applyBrightness(const TargetImage& target,
                                         const HostPatch& host,
                                         Patch& out) {
  Lanes grey;
  load(host.grey.data(), grey);
  if constexpr (kModel == PhotometricBrightness::kAffine) {
    out.J[6] = -target.gain * grey;
    fill(-1, out.J[7]);
    out.residual -= target.gain * grey + target.offset;
  } else {
    const float sum = sumLanes(grey);
    const Lanes share = grey / (sum > kMinGreySum ? sum : kMinGreySum);
    out.residual -= sumLanes(out.residual) * share;
  }
}

DSORB_ALWAYS_INLINE void weigh(const HostPatch& host, Patch& out) {
  Lanes zero;
  fill(0, zero);
  Lanes threshold;
  fill(kHuberThreshold, threshold);
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
constexpr int kSize = kModel == PhotometricBrightness::kAffine ? 8 : 6;

template <PhotometricBrightness kModel>
DSORB_ALWAYS_INLINE void clearCoupling(const PatchSums& sums, std::size_t i) {
  for (std::size_t k = 0; k < kSize<kModel>; ++k) {
    sums.points.coupling[i * sums.points.stride + k] = 0;
  }
}

template <PhotometricBrightness kModel>
DSORB_ALWAYS_INLINE void addFrameSums(const Patch& patch, Lanes* totals) {
  int entry = 0;
  for (int i = 0; i < kSize<kModel>; ++i) {
    const Lanes weighted = patch.weight * patch.J[i];
    for (int j = i; j < kSize<kModel>; ++j) totals[entry++] += weighted * patch.J[j];
    totals[entry++] += weighted * patch.residual;
  }
}

template <PhotometricBrightness kModel, bool kPoses>
DSORB_ALWAYS_INLINE void addPatchSums(const Patch& patch, const PatchSums& sums, std::size_t i) {
  const Lanes weighted = patch.weight * patch.J[8];
  sums.energy[i] += sumLanes(patch.energy);
  if constexpr (!kPoses) {
    sums.points.hessian[i] += sumLanes(weighted * patch.J[8]);
    sums.points.gradient[i] += sumLanes(weighted * patch.residual);
    return;
  }
  float* coupling = sums.points.coupling + i * sums.points.stride;
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
  for (int k = 0; k < 6; ++k) coupling[k] = totals[k];
  if constexpr (kAffine) {
    coupling[6] = totals[6];
    coupling[7] = totals[7];
    sums.points.hessian[i] += sumLanes(hessian);
    sums.points.gradient[i] += sumLanes(gradient);
  } else {
    sums.points.hessian[i] += totals[6];
    sums.points.gradient[i] += totals[7];
  }
}

template <PhotometricBrightness kModel, bool kPoses>
DSORB_ALWAYS_INLINE void linearizeRun(const TargetImage& target,
                                      const PatchRun& run,
                                      const PatchSums& sums,
                                      Lanes* totals) {
  LaneSetting lanes;
  spreadPattern(target, lanes);
  for (std::size_t i = 0; i < run.count; ++i) {
    if (run.seen[i] == 0) {
      if constexpr (kPoses) clearCoupling<kModel>(sums, i);
      continue;
    }
    Patch patch;
    projectPatch<kPoses>(target, lanes, run.patches[i], run.inverse_depth[i], patch);
    applyBrightness<kModel>(target, run.patches[i], patch);
    weigh(run.patches[i], patch);
    if constexpr (kPoses) addFrameSums<kModel>(patch, totals);
    addPatchSums<kModel, kPoses>(patch, sums, i);
  }
}

template <PhotometricBrightness kModel>
DSORB_ALWAYS_INLINE void evaluateRun(const TargetImage& target,
                                     const PatchRun& run,
                                     float* residual,
                                     char* inside) {
  LaneSetting lanes;
  spreadPattern(target, lanes);
  for (std::size_t i = 0; i < run.count; ++i) {
    if (run.seen != nullptr && run.seen[i] == 0) {
      inside[i] = 0;
      continue;
    }
    Patch patch;
    projectPatch<false>(target, lanes, run.patches[i], run.inverse_depth[i], patch);
    inside[i] = inAllLanes(patch.inside) ? 1 : 0;
    if (residual == nullptr) continue;
    applyBrightness<kModel>(target, run.patches[i], patch);
    store(patch.residual, residual + i * kLanes);
  }
}

template <bool kPoses>
DSORB_ALWAYS_INLINE void linearizeAs(const TargetImage& target,
                                     PhotometricBrightness brightness,
                                     const PatchRun& run,
                                     const PatchSums& sums,
                                     Lanes* totals) {
  switch (brightness) {
    case PhotometricBrightness::kPsiFixed:
      return linearizeRun<PhotometricBrightness::kPsiFixed, kPoses>(target, run, sums, totals);
    case PhotometricBrightness::kAffine:
      return linearizeRun<PhotometricBrightness::kAffine, kPoses>(target, run, sums, totals);
  }
}

DSORB_TARGET_CLONES void linearizeWithPoses(const TargetImage& target,
                                            PhotometricBrightness brightness,
                                            const PatchRun& run,
                                            const PatchSums& sums,
                                            Lanes* totals) {
  linearizeAs<true>(target, brightness, run, sums, totals);
}

DSORB_TARGET_CLONES void linearizeDepths(const TargetImage& target,
                                         PhotometricBrightness brightness,
                                         const PatchRun& run,
                                         const PatchSums& sums) {
  linearizeAs<false>(target, brightness, run, sums, nullptr);
}

DSORB_TARGET_CLONES void evaluateAs(const TargetImage& target,
                                    PhotometricBrightness brightness,
                                    const PatchRun& run,
                                    float* residual,
                                    char* inside) {
  switch (brightness) {
    case PhotometricBrightness::kPsiFixed:
      return evaluateRun<PhotometricBrightness::kPsiFixed>(target, run, residual, inside);
    case PhotometricBrightness::kAffine:
      return evaluateRun<PhotometricBrightness::kAffine>(target, run, residual, inside);
  }
}

}  // namespace

void linearizePatches(const TargetImage& target,
                      PhotometricBrightness brightness,
                      const PatchRun& run,
                      const PatchSums& sums,
                      std::array<float, kFrameSums>& frame) {
  if (sums.points.coupling == nullptr) {
    linearizeDepths(target, brightness, run, sums);
    return;
  }
  Lanes totals[kFrameSums] = {};
  linearizeWithPoses(target, brightness, run, sums, totals);
  for (std::size_t i = 0; i < kFrameSums; ++i) frame[i] += sumLanes(totals[i]);
}

void evaluatePatches(const TargetImage& target,
                     PhotometricBrightness brightness,
                     const PatchRun& run,
                     float* residual,
                     char* inside) {
  evaluateAs(target, brightness, run, residual, inside);
}

}  // namespace dsorb::init_orb
