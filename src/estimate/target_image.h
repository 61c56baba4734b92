// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/affine_brightness.h"
#include "dsorb/image/pyramid.h"

#include "estimate/sampling.h"
#include "estimate/warp.h"

namespace dsorb {

/// An image that hosted patches are compared with, in single precision.
struct TargetImage {
  Warp<float> warp;            ///< host to it
  float gain, offset;          ///< I_target = gain I_host + offset
  const ImageSample* samples;  ///< row by row
  int width, height;           ///< [px]
};

inline TargetImage makeTargetImage(const PinholeCamera& camera,
                                   const SE3& T_target_host,
                                   const BrightnessTransfer& transfer,
                                   const PyramidLevel& image) {
  return {makeWarp<float>(camera, T_target_host),
          static_cast<float>(transfer.gain),
          static_cast<float>(transfer.offset),
          image.data(),
          image.width(),
          image.height()};
}

/// Samples at projected points; outside the image at the nearest position inside.
/// @param area   of the image, sampleArea()
/// @param inside the point is in front and inside the image
DSORB_ALWAYS_INLINE void sampleTarget(const TargetImage& target,
                                      const SampleArea<Lanes>& area,
                                      const WarpedPoint<Lanes>& point,
                                      LaneSamples& samples,
                                      MaskOf<Lanes>& inside) {
  SamplePosition<Lanes> at;
  clampToArea(area, point, at);
  interpolateLanes(target.samples, target.width, at.x, at.y, samples);
  inside = point.front & at.inside;
}

/// Whether a mask holds in all lanes.
DSORB_ALWAYS_INLINE bool inAllLanes(const MaskOf<Lanes>& mask) {
  int all = -1;
  for (int k = 0; k < kLanes; ++k) all &= mask[k];
  return all != 0;
}

}  // namespace dsorb
