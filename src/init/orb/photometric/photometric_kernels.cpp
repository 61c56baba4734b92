// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/photometric/photometric_kernels.h"

#include "base/lanes.h"
#include "base/target_clones.h"
#include "estimate/robust_loss.h"

namespace dsorb::init_orb {
namespace {

/// Residual, weight and derivatives of one patch: columns 0..5 pose, 6 and 7 brightness, 8 depth.
struct Patch {
  Lanes J[9];
  Lanes residual;
  Lanes weight;
  Lanes energy;
  LaneMask inside;
};

/// Projects, samples and differentiates, before brightness. @return intensities in `residual`
template <bool kRolling, bool kPoses>
DSORB_ALWAYS_INLINE void projectPatch(const PatchImage& image,
                                      const HostPatch& host,
                                      float rho,
                                      Patch& out) {
  WarpedPattern pattern;
  warpPattern<kRolling>(image.target, image.rays, host.pixel, rho, pattern);
  const LaneSamples& seen = pattern.seen;
  out.inside = pattern.inside & (seen.intensity == seen.intensity);  // not NaN
  out.residual = seen.intensity;
  const Warp<float>& warp = image.target.warp;
  const Lanes zero = {};
  const Lanes dx = pattern.inside ? seen.dx : zero;
  const Lanes dy = pattern.inside ? seen.dy : zero;
  RayGradient<Lanes> gradient;
  rayGradient(warp, pattern.at, dx, dy, gradient);
  depthJacobian(warp, pattern.at, gradient, out.J[8]);
  if constexpr (kPoses) poseJacobian(pattern.at, gradient, rho * pattern.at.inverse_z, out.J);
}

DSORB_ALWAYS_INLINE void applyBrightness(const PatchImage& image,
                                         const HostPatch& host,
                                         Patch& out) {
  Lanes grey;
  load(host.grey.data(), grey);
  if (image.brightness == PhotometricBrightness::kAffine) {
    out.J[6] = -image.target.gain * grey;
    fill(-1, out.J[7]);
    out.residual -= image.target.gain * grey + image.target.offset;
  } else {
    const float sum = sumLanes(grey);
    const Lanes share = grey / (sum > kMinGreySum ? sum : kMinGreySum);
    out.residual -= sumLanes(out.residual) * share;
  }
}

DSORB_ALWAYS_INLINE void weigh(const HostPatch& host, Patch& out) {
  const Lanes zero = {};
  Lanes root;
  Lanes robust;
  load(host.root_weight.data(), root);
  const LaneMask valid = out.residual == out.residual;  // not NaN
  const Lanes r = valid ? out.residual : zero;
  Lanes energy;
  huberWeights(r, robust);
  huberEnergies(r, robust, energy);
  out.residual = r;
  const Lanes weight = root * root;
  out.weight = valid ? weight * robust : zero;
  // A pixel without a value costs what one at the threshold does: a patch gains nothing by moving
  // where the image is invalid.
  out.energy = weight * (valid ? energy : zero + kHuberThreshold * kHuberThreshold);
}

/// @tparam kSize unknowns of the frame; 0: it is fixed
template <bool kRolling, int kSize>
DSORB_ALWAYS_INLINE void linearizeRun(const PatchImage& image,
                                      const PatchRun& run,
                                      const PatchTotals& sums,
                                      Lanes* totals) {
  for (std::size_t i = 0; i < run.count; ++i) {
    float* coupling = sums.points.coupling + i * sums.points.stride;
    if (run.seen[i] == 0) {
      for (int k = 0; k < kSize; ++k) coupling[k] = 0;
      continue;
    }
    Patch patch;
    projectPatch<kRolling, (kSize > 0)>(image, run.patches[i], run.inverse_depth[i], patch);
    applyBrightness(image, run.patches[i], patch);
    weigh(run.patches[i], patch);
    const Lanes weighted = patch.weight * patch.J[8];
    sums.energy[i] += sumLanes(patch.energy);
    sums.points.hessian[i] += sumLanes(weighted * patch.J[8]);
    sums.points.gradient[i] += sumLanes(weighted * patch.residual);
    if constexpr (kSize > 0) {
      addToTriangle<kSize>(patch.J, patch.weight, patch.residual, totals);
      Lanes terms[8] = {};
      for (int k = 0; k < kSize; ++k) terms[k] = weighted * patch.J[k];
      Lanes by_unknown;
      sumLanes(terms, by_unknown);
      for (int k = 0; k < kSize; ++k) coupling[k] = by_unknown[k];
    }
  }
}

template <bool kRolling>
DSORB_ALWAYS_INLINE void linearizeBySize(const PatchImage& image,
                                         const PatchRun& run,
                                         const PatchTotals& sums,
                                         Lanes* totals) {
  if (totals == nullptr) {
    linearizeRun<kRolling, 0>(image, run, sums, totals);
  } else if (image.brightness == PhotometricBrightness::kAffine) {
    linearizeRun<kRolling, 8>(image, run, sums, totals);
  } else {
    linearizeRun<kRolling, 6>(image, run, sums, totals);
  }
}

DSORB_TARGET_CLONES void linearize(const PatchImage& image,
                                   const PatchRun& run,
                                   const PatchTotals& sums,
                                   Lanes* totals) {
  linearizeBySize<false>(image, run, sums, totals);
}

DSORB_TARGET_CLONES void linearizeRolling(const PatchImage& image,
                                          const PatchRun& run,
                                          const PatchTotals& sums,
                                          Lanes* totals) {
  linearizeBySize<true>(image, run, sums, totals);
}

template <bool kRolling>
DSORB_ALWAYS_INLINE void evaluateRun(const PatchImage& image,
                                     const PatchRun& run,
                                     float* residual,
                                     char* inside) {
  for (std::size_t i = 0; i < run.count; ++i) {
    if (run.seen != nullptr && run.seen[i] == 0) {
      inside[i] = 0;
      continue;
    }
    Patch patch;
    projectPatch<kRolling, false>(image, run.patches[i], run.inverse_depth[i], patch);
    inside[i] = inAllLanes(patch.inside) ? 1 : 0;
    if (residual == nullptr) continue;
    applyBrightness(image, run.patches[i], patch);
    store(patch.residual, residual + i * kLanes);
  }
}

DSORB_TARGET_CLONES void evaluate(const PatchImage& image,
                                  const PatchRun& run,
                                  float* residual,
                                  char* inside) {
  evaluateRun<false>(image, run, residual, inside);
}

DSORB_TARGET_CLONES void evaluateRolling(const PatchImage& image,
                                         const PatchRun& run,
                                         float* residual,
                                         char* inside) {
  evaluateRun<true>(image, run, residual, inside);
}

}  // namespace

void linearizePatches(const PatchImage& image,
                      const PatchRun& run,
                      const PatchTotals& sums,
                      std::array<float, kFrameSums>& frame) {
  const auto sum_up = image.target.corrected ? linearizeRolling : linearize;
  if (sums.points.coupling == nullptr) return sum_up(image, run, sums, nullptr);
  Lanes totals[kFrameSums] = {};
  sum_up(image, run, sums, totals);
  for (std::size_t i = 0; i < kFrameSums; ++i) frame[i] += sumLanes(totals[i]);
}

void evaluatePatches(const PatchImage& image, const PatchRun& run, float* residual, char* inside) {
  if (image.target.corrected) return evaluateRolling(image, run, residual, inside);
  evaluate(image, run, residual, inside);
}

}  // namespace dsorb::init_orb
