// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/options/orb_mapping.h"

#include "estimate/host_patch.h"
#include "estimate/linear_system.h"
#include "estimate/triangle_sums.h"

#include <array>
#include <cstddef>

/// The inner loops of the photometric adjustment: one lane a pixel of the pattern.
namespace dsorb::init_orb {

constexpr std::size_t kPatchBlock = 128;  ///< patches summed in float before doubles take over
constexpr float kMinGreySum = 8;  ///< of a patch; psi of a darker one means nothing [grey levels]
constexpr int kMaxFrameSize = 8;  ///< unknowns of a frame: pose 6, brightness a and b
constexpr std::size_t kFrameSums = triangleSums(kMaxFrameSize);

/// Unknowns of one frame beside the depths.
inline int frameSize(PhotometricBrightness brightness) {
  return brightness == PhotometricBrightness::kAffine ? 8 : 6;
}

/// A frame that patches are compared with.
struct PatchImage {
  TargetImage target;
  HostRays rays;
  PhotometricBrightness brightness;
};

/// A run of patches, few enough to be summed in single precision.
struct PatchRun {
  const HostPatch* patches;
  const float* inverse_depth;
  const char* seen;
  std::size_t count;
};

/// Sums over the pixels of each patch, added to what is there; couplings are set, also those of
/// patches that are not seen.
struct PatchTotals {
  PointSums<float> points;
  float* energy = nullptr;  ///< Huber energy, huberEnergies()
};

/// @param sums  from the first patch on; without couplings poses are fixed
/// @param frame sums over all patches, the rows of the triangle that frameSize() wants
void linearizePatches(const PatchImage& image,
                      const PatchRun& run,
                      const PatchTotals& sums,
                      std::array<float, kFrameSums>& frame);

/// Residuals of a run of patches without derivatives. A patch that is not seen gives none.
/// @param run      `seen` may be null: all are
/// @param residual kPatternSize a patch [grey levels]; null: not wanted
/// @param inside   by patch: the whole pattern inside the image, in front, and valid; may be
///                 `run.seen`
void evaluatePatches(const PatchImage& image, const PatchRun& run, float* residual, char* inside);

}  // namespace dsorb::init_orb
