// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/image/pyramid.h"

#include "estimate/pattern_sampling.h"
#include "estimate/robust_loss.h"
#include "window/pair_geometry.h"

#include <cmath>
#include <cstddef>

namespace dsorb::window {

constexpr float kResidualLowMargin = 1.1F;   // [px] pattern pixels keep this from the image edge
constexpr float kResidualHighMargin = 3.0F;  // [px]
constexpr float kMinTexture = 2.0F;  // least weighted squared gradient of a residual [grey^2/px^2]

/// The photometric half of one residual: 8 pixels summed up, because they share one geometry. With
/// the weighted image gradient (x, y) and brightness derivatives (a, b) of every pixel, its
/// residual r, and the pattern summed: xx = sum of x x, and so on.
struct PatchSums {
  float xx = 0, xy = 0, yy = 0;
  float xa = 0, ya = 0, xb = 0, yb = 0;
  float aa = 0, ab = 0, bb = 0;
  float xr = 0, yr = 0, ar = 0, br = 0;
  float energy = 0;   ///< robust and weighted [grey levels^2]
  float texture = 0;  ///< sum of fourth powers of the weights times squared gradient
};

/// Lanes of a row of the pair's normal equations. The first eight are the relative state.
constexpr std::size_t kLaneA = 6;
constexpr std::size_t kLaneB = 7;
constexpr std::size_t kLaneResidual = 8;
constexpr std::size_t kLaneCamera = 9;
constexpr std::size_t kLanes = 16;
constexpr std::size_t kLanesWithoutCamera = 12;

/// The geometric half: derivatives of the pixel of the pattern's centre.
struct ResidualGeometry {
  /// Rows of d(u, v): [translation, rotation | a, b, r: zero | fx, fy, cx, cy scaled | zero].
  alignas(32) float x[kLanes] = {};
  alignas(32) float y[kLanes] = {};
  float depth_x = 0;  ///< du / d(inverse depth) [px unit]
  float depth_y = 0;
};

/// Residuals of the pattern at the current state.
/// @param point  host pixel, inverse depth, host intensities and weights
/// @param level  level 0 of the target
/// @return       false if any pixel leaves the image, lies behind the camera or is invalid
/// @source       Engel et al., DSO, arXiv:1607.02565, eq. (4); weight: mean of the host's and the
///               target's square roots of eq. (7), squared (DSO as published)
inline bool evaluatePatch(const WindowPoint& point,
                          const PairGeometry& pair,
                          const PyramidLevel& level,
                          PatchSums& sums) {
  using Lanes = PatternLanes;
  const Lanes px = patternX() + point.pixel.x();
  const Lanes py = patternY() + point.pixel.y();
  const Eigen::Vector3f origin = pair.KRKi.col(2) + pair.Kt * point.inverse_depth;
  const Lanes z = pair.KRKi(2, 0) * px + pair.KRKi(2, 1) * py + origin.z();
  const Lanes inverse_z = 1.0F / z;
  const Lanes u = (pair.KRKi(0, 0) * px + pair.KRKi(0, 1) * py + origin.x()) * inverse_z;
  const Lanes v = (pair.KRKi(1, 0) * px + pair.KRKi(1, 1) * py + origin.y()) * inverse_z;
  const bool inside = z.minCoeff() > 0 && u.minCoeff() > kResidualLowMargin &&
                      v.minCoeff() > kResidualLowMargin &&
                      u.maxCoeff() < static_cast<float>(level.width()) - kResidualHighMargin &&
                      v.maxCoeff() < static_cast<float>(level.height()) - kResidualHighMargin;
  if (!inside) return false;
  const PatternSamples samples = samplePattern(level, u, v);
  const Eigen::Map<const Lanes> host(point.patch.intensity.data());
  const Eigen::Map<const Lanes> host_weight(point.patch.weight.data());
  const Lanes residual = samples.intensity - (pair.gain * host + pair.offset);

  constexpr float kC = 50.0F;  // of gradientWeight
  const Lanes squared_gradient = samples.dx.square() + samples.dy.square();
  const Lanes target_weight = kC / (squared_gradient + kC * kC).sqrt();
  const Lanes weight = (0.5F * (target_weight + host_weight)).square();
  const Lanes huber = (kHuberThreshold / residual.abs().max(1e-6F)).min(1.0F);
  const Lanes w = weight * huber;
  const Lanes wx = w * samples.dx;
  const Lanes wy = w * samples.dy;
  const Lanes wr = w * residual;
  const Lanes radiance = host - pair.host_offset_first;
  const Lanes wa = w * radiance;
  sums.energy = (wr * residual * (2.0F - huber)).sum();
  if (!std::isfinite(sums.energy)) return false;
  sums.texture = (weight * w * squared_gradient).sum();
  sums.xx = (wx * samples.dx).sum();
  sums.xy = (wx * samples.dy).sum();
  sums.yy = (wy * samples.dy).sum();
  sums.xa = (wx * radiance).sum();
  sums.ya = (wy * radiance).sum();
  sums.xb = wx.sum();
  sums.yb = wy.sum();
  sums.aa = (wa * radiance).sum();
  sums.ab = wa.sum();
  sums.bb = w.sum();
  sums.xr = (wx * residual).sum();
  sums.yr = (wy * residual).sum();
  sums.ar = (wa * residual).sum();
  sums.br = wr.sum();
  return true;
}

/// Derivatives of the projected centre: poses at their first estimates, inverse depth and
/// intrinsics current.
/// @param with_camera  also by the intrinsics, scaled by kCameraScale
/// @return             false if the point is not in front of the target at the first estimates
/// @source             derived in photometric_residual_test; relative pose by left increments
bool evaluateGeometry(const WindowPoint& point,
                      const PairGeometry& pair,
                      const PinholeCamera& camera,
                      bool with_camera,
                      ResidualGeometry& geometry);

}  // namespace dsorb::window
