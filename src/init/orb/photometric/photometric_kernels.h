// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "init/orb/photometric/photometric_patch.h"

#include <array>
#include <cstddef>

/// The inner loops of the photometric adjustment: one lane a pixel of the pattern.
namespace dsorb::init_orb {

constexpr std::size_t kPatchBlock = 128;  ///< patches summed in float before doubles take over
constexpr int kMaxFrameSize = 8;          ///< unknowns of a frame: pose 6, brightness a and b
/// Upper triangle of J J^T, each row followed by its product with the residual.
constexpr std::size_t kFrameSums = 44;

/// Unknowns of one frame beside the depths.
inline int frameSize(PhotometricBrightness brightness) {
  return brightness == PhotometricBrightness::kAffine ? 8 : 6;
}

/// Everything that is the same for all patches of one frame, in single precision.
struct PatchSetting {
  std::array<float, 9> R;  ///< rotation reference to frame, row-major
  std::array<float, 3> t;  ///< translation reference to frame [unit]
  float fx, fy, cx, cy;    ///< of the level [px]
  float gain, offset;      ///< I_frame = gain I_reference + offset
  float huber_threshold;   ///< [grey levels]
  const ImageSample* image;
  int width, height;
  PhotometricBrightness brightness;
};
PatchSetting patchSetting(const PatchTarget& target,
                          PhotometricBrightness brightness,
                          double huber_threshold);

/// A run of patches, few enough to be summed in single precision.
struct PatchRun {
  const HostPatch* patches;
  const float* inverse_depth;
  const char* seen;
  std::size_t count;
};

/// Sums over the pixels of each patch, added to what is there.
struct PatchSums {
  float* coupling = nullptr;  ///< frame by inverse depth; null: no sums of frames are wanted
  std::size_t stride = 0;     ///< of `coupling` from patch to patch
  float* depth_hessian = nullptr;
  float* depth_gradient = nullptr;
  float* energy = nullptr;  ///< Huber energy, huberEnergy()
};

/// @param sums  from the first patch on
/// @param frame sums over all patches, the rows of the triangle that frameSize() wants
void linearizePatches(const PatchSetting& setting,
                      const PatchRun& run,
                      const PatchSums& sums,
                      std::array<float, kFrameSums>& frame);

/// Residuals of a run of patches without derivatives. A patch that is not seen gives none.
/// @param run      `seen` may be null: all are
/// @param residual kPatternSize a patch [grey levels]; null: not wanted
/// @param inside   by patch: the whole pattern inside the image, in front, and valid; may be
///                 `run.seen`
void evaluatePatches(const PatchSetting& setting,
                     const PatchRun& run,
                     float* residual,
                     char* inside);

/// Couplings of some patches for their elimination.
struct EliminationRun {
  const float* coupling;  ///< c, one row a patch
  std::size_t size;       ///< of a row, a multiple of 8
  const float* inverse;   ///< 1 / h, one a patch
  const float* gradient;  ///< b, one a patch
  std::size_t count;
};

/// Adds the sum of c c^T / h to `matrix` (row-major; of each row the blocks of 8 from its diagonal
/// on) and that of c b / h to `vector`.
void accumulateSchur(const EliminationRun& run, float* matrix, float* vector);

}  // namespace dsorb::init_orb
