// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/affine_brightness.h"
#include "dsorb/image/pyramid.h"

#include "estimate/rolling_shutter.h"
#include "estimate/sampling.h"
#include "estimate/warp.h"

namespace dsorb {

/// An image that hosted patches are compared with, in single precision.
struct TargetImage {
  Warp<float> warp;          ///< host to it
  float gain, offset;        ///< I_target = gain I_host + offset
  const float* pixels;       ///< row by row [grey levels]
  int width, height;         ///< [px]
  bool corrected = false;    ///< its pixels are not where a global shutter would see them:
  RollingShutter shutter{};  ///< set only then

  void setShutter(const RollingShutter& of_image) {
    shutter = of_image;
    corrected = true;
  }
};

inline TargetImage makeTargetImage(const PinholeCamera& camera,
                                   const SE3& T_target_host,
                                   const BrightnessTransfer& transfer,
                                   const PyramidLevel& image) {
  TargetImage target;
  target.warp = makeWarp<float>(camera, T_target_host);
  target.gain = static_cast<float>(transfer.gain);
  target.offset = static_cast<float>(transfer.offset);
  target.pixels = image.data();
  target.width = image.width();
  target.height = image.height();
  return target;
}

/// A hosted point in the image: u, v and inverse_z at the time of its middle row, x and y where its
/// own row sees it.
/// @tparam kRolling the image's `corrected`: kernels are compiled for both, and a global shutter
///                  costs nothing
/// @param ray_x, ray_y of the point in the host, z = 1
/// @param rho          inverse depth in the host [1/unit], one for all lanes or one each
template <bool kRolling, typename Depth>
DSORB_ALWAYS_INLINE WarpedPoint<Lanes> projectInto(const TargetImage& target,
                                                   const Lanes& ray_x,
                                                   const Lanes& ray_y,
                                                   const Depth& rho) {
  WarpedPoint<Lanes> point = warpPoint(target.warp, ray_x, ray_y, rho);
  if constexpr (kRolling) {
    const Lanes target_rho = rho * point.inverse_z;
    moveToRow(target.shutter, target.warp, target_rho, point);
  }
  return point;
}

/// Samples at projected points; outside the image at the nearest position inside.
/// @param inside the point is in front and inside the image
DSORB_ALWAYS_INLINE LaneSamples sampleTarget(const TargetImage& target,
                                             const WarpedPoint<Lanes>& point,
                                             MaskOf<Lanes>& inside) {
  const auto area = sampleArea<Lanes>(target.width, target.height);
  const SamplePosition<Lanes> at = clampToArea(area, point);
  inside = point.front & at.inside;
  return interpolateLanes(target.pixels, target.width, at.x, at.y);
}

/// Makes the gradients of samples those by the pixel of a pinhole camera.
template <bool kRolling>
DSORB_ALWAYS_INLINE void unbendGradients(const TargetImage& target,
                                         const WarpedPoint<Lanes>& point,
                                         LaneSamples& samples) {
  if constexpr (kRolling) {
    if (target.shutter.radial == 0) return;
    const float ratio = target.warp.fy / target.warp.fx;
    bendGradient(target.shutter.radial, {point.u, point.v}, ratio, samples.dx, samples.dy);
  }
}

}  // namespace dsorb
