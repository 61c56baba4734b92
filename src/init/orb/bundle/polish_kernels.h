// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/geometry/se3.h"
#include "dsorb/image/affine_brightness.h"
#include "dsorb/image/pyramid.h"

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

/// Everything that is the same for all corners of one frame.
struct PolishFrame {
  const ImageSample* image;
  int width, height;
  float fx, fy, cx, cy;  ///< [px]
  std::array<float, 3>
      by_x;  ///< change of a direction in the frame by the reference's pixel [1/px]
  std::array<float, 3> by_y;
  float gain, offset;     ///< I_frame = gain I_reference + offset
  float huber_threshold;  ///< [grey levels]
};
PolishFrame polishFrame(const PinholeCamera& camera,
                        const SE3& T_cam_ref,
                        const BrightnessTransfer& transfer,
                        const PyramidLevel& image);

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
/// @param direction of the corner in the frame, not normalised
/// @return          false where the patch leaves the image or is invalid
bool linearizePolish(const PolishFrame& frame,
                     const PolishPatch& patch,
                     const std::array<float, 3>& direction,
                     PolishSums& sums);

}  // namespace dsorb::init_orb
