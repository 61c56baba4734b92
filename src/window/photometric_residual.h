// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "window/pair_geometry.h"

#include <cstddef>

namespace dsorb::window {

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

constexpr int kPoseRows = 6;
constexpr std::size_t kPoseLanes = 8;  ///< of a row that holds a pose alone

/// Lanes of a row of the pair's normal equations. The first eight are the relative state.
constexpr std::size_t kLaneA = 6;
constexpr std::size_t kLaneB = 7;
constexpr std::size_t kLaneResidual = 8;
constexpr std::size_t kLaneCamera = 9;
constexpr std::size_t kLaneReadout = kLaneCamera + kReadout;
constexpr std::size_t kRowLanes = 16;

/// The geometric half: derivatives of the pixel of the pattern's centre.
struct ResidualGeometry {
  /// Rows of d(u, v): [translation, rotation | a, b, r: zero | fx, fy, cx, cy, readout, radial
  /// scaled | zero].
  alignas(32) float x[kRowLanes] = {};
  alignas(32) float y[kRowLanes] = {};
  float depth_x = 0;  ///< du / d(inverse depth) [px unit]
  float depth_y = 0;
  // Rolling shutter: times of the rows that see and host the point [1 / kVelocityScale]. A velocity
  // moves the pixel as the pose does in that time, but for what is along the epipolar line.
  float target_time = 0;
  float host_time = 0;
};

/// Asks for the part of the target's image that evaluatePatch() will read: the images of a window
/// are larger than the caches, and waiting for them takes longer than computing with them.
DSORB_ALWAYS_INLINE void prefetchPatch(const WindowPoint& point,
                                       const HostRays& rays,
                                       const PairGeometry& pair) {
  float ray_x = 0;
  float ray_y = 0;
  rays.at(point.patch.pixel.x(), point.patch.pixel.y(), ray_x, ray_y);
  WarpedPoint<float> p;
  warpPoint(pair.current.warp, ray_x, ray_y, point.inverse_depth, p);
  const float margin = kPatternRadius + kFarBorder;
  const TargetImage& target = pair.current;
  const bool inside = p.x > margin && p.y > margin &&
                      p.x < static_cast<float>(target.width) - margin &&
                      p.y < static_cast<float>(target.height) - margin;
  if (!inside) return;
  // The pattern, its interpolation and its gradients.
  constexpr int kSide = 2 * kPatternRadius + 3;
  constexpr int kBefore = kPatternRadius + 1;
  const float* row = target.pixels + (static_cast<std::ptrdiff_t>(p.y) - kBefore) * target.width +
                     (static_cast<std::ptrdiff_t>(p.x) - kBefore);
  for (int y = 0; y <= kSide; ++y, row += target.width) {
    __builtin_prefetch(row);
    __builtin_prefetch(row + kSide);
  }
}

/// Residuals of the pattern at the current state.
/// @param point host pixel, inverse depth, host intensities and weights
/// @return      false if any pixel leaves the image, lies behind the camera or is invalid
/// @source      Engel et al., DSO, arXiv:1607.02565, eq. (4); weight: mean of the host's and the
///              target's square roots of eq. (7), squared (DSO as published)
bool evaluatePatch(const WindowPoint& point,
                   const HostRays& rays,
                   const PairGeometry& pair,
                   PatchSums& sums);

/// What is estimated of the camera.
struct EstimatedCamera {
  bool intrinsics = false;
  bool readout = false;  ///< of a rolling shutter
  bool radial = false;   ///< distortion, beside the intrinsics

  [[nodiscard]] bool any() const { return intrinsics || readout; }
  /// @param row of the camera's state
  [[nodiscard]] bool has(Eigen::Index row) const {
    if (row == kReadout) return readout;
    return row == kRadial ? radial : intrinsics;
  }
};

/// Derivatives of the projected centre: poses at their first estimates, inverse depth and camera
/// current.
/// @param camera       also by the camera's state, scaled as that is, at constant motions
/// @return             false if the point is not in front of the target at the first estimates
/// @source             derived in photometric_residual_test; relative pose by left increments
bool evaluateGeometry(const WindowPoint& point,
                      const HostRays& rays,
                      const PairGeometry& pair,
                      EstimatedCamera camera,
                      ResidualGeometry& geometry);

}  // namespace dsorb::window
