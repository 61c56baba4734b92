// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/pyramid.h"

#include "estimate/target_image.h"

#include <array>
#include <cstddef>

/// The inner loops of the polish: one lane a pixel of the patch.
namespace dsorb::init_orb {

constexpr int kPolishSide = 5;
constexpr int kPolishStep = 2;  ///< [px] between two samples
constexpr std::size_t kPolishPixels = std::size_t{kPolishSide} * kPolishSide;
constexpr std::size_t kPolishLanes = 32;  ///< pixels filled up to whole lanes

/// Grey values of the reference around a corner.
struct PolishPatch {
  std::array<float, kPolishLanes> grey{};
  bool valid = false;  ///< inside the image
};
PolishPatch cutPolishPatch(const PyramidLevel& reference, float x, float y);

/// A corner in the reference.
struct PolishRay {
  float x, y;           ///< at z = 1
  float inverse_depth;  ///< [1/unit]
};

/// Sums over the pixels of a patch; w is Huber's weight.
struct PolishSums {
  float xx = 0;  ///< w gradient gradient^T
  float xy = 0;
  float yy = 0;
  float x = 0;  ///< w residual gradient
  float y = 0;
  float square = 0;     ///< w residual^2
  float weight = 0;     ///< w
  float magnitude = 0;  ///< |residual|
};

/// Residuals of a corner's patch, warped into a frame, over a shift of the patch there.
/// @return false where the patch leaves the image or is invalid
bool linearizePolish(const TargetImage& target,
                     const PolishPatch& patch,
                     const PolishRay& ray,
                     PolishSums& sums);

}  // namespace dsorb::init_orb
