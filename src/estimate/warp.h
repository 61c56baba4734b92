// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/geometry/se3.h"

#include "base/lanes.h"
#include "estimate/sampling.h"

#include <Eigen/Core>

#include <optional>
#include <utility>

/// How a point hosted in one frame, with a ray and an inverse depth, meets another image. All
/// functions work on single numbers and on lanes: T is float, double, Lanes or DoubleLanes.
namespace dsorb {

/// Least depth in the target over depth in the host [-]; nearer points count as behind it.
constexpr double kMinWarpZ = 1e-3;

/// All that is the same for the points hosted in one frame and seen in another.
template <typename Scalar>
struct Warp {
  Scalar R[9];            ///< rotation host to target, row-major
  Scalar t[3];            ///< translation host to target [unit]
  Scalar fx, fy, cx, cy;  ///< of the target's image [px]

  void setCamera(const PinholeCamera& camera) {
    fx = static_cast<Scalar>(camera.fx);
    fy = static_cast<Scalar>(camera.fy);
    cx = static_cast<Scalar>(camera.cx);
    cy = static_cast<Scalar>(camera.cy);
  }
};

template <typename Scalar>
Warp<Scalar> makeWarp(const PinholeCamera& camera, const SE3& T_target_host) {
  Warp<Scalar> warp;
  const Eigen::Matrix3d R = T_target_host.rotationMatrix();
  for (int i = 0; i < 9; ++i) warp.R[i] = static_cast<Scalar>(R(i / 3, i % 3));
  for (int i = 0; i < 3; ++i) warp.t[i] = static_cast<Scalar>(T_target_host.translation()[i]);
  warp.setCamera(camera);
  return warp;
}

/// What comparing two T gives: bool, or lanes of integers.
template <typename T>
using MaskOf = decltype(std::declval<T>() > std::declval<T>());

template <typename T>
struct WarpedPoint {
  T u, v;           ///< ray in the target, z = 1
  T inverse_z;      ///< depth in the host over depth in the target [-]
  T x, y;           ///< pixel in the target [px]
  MaskOf<T> front;  ///< in front of the target; what is not is projected as if at kMinWarpZ
};

/// p = R ray + rho t is the point times rho, so infinity (rho = 0) needs no special case.
/// @param ray_x, ray_y of the point in the host, z = 1
/// @param rho          inverse depth in the host [1/unit], one for all lanes or one each
template <typename Scalar, typename T, typename Depth>
DSORB_ALWAYS_INLINE WarpedPoint<T> warpPoint(const Warp<Scalar>& w,
                                             const T& ray_x,
                                             const T& ray_y,
                                             const Depth& rho) {
  const T px = w.R[0] * ray_x + w.R[1] * ray_y + (w.R[2] + rho * w.t[0]);
  const T py = w.R[3] * ray_x + w.R[4] * ray_y + (w.R[5] + rho * w.t[1]);
  const T pz = w.R[6] * ray_x + w.R[7] * ray_y + (w.R[8] + rho * w.t[2]);
  const T min_z = spread<T>(static_cast<Scalar>(kMinWarpZ));
  WarpedPoint<T> out;
  out.front = pz > min_z;
  out.inverse_z = Scalar{1} / (out.front ? pz : min_z);
  out.u = px * out.inverse_z;
  out.v = py * out.inverse_z;
  out.x = w.fx * out.u + w.cx;
  out.y = w.fy * out.v + w.cy;
  return out;
}

/// Derivatives of the pixel by the inverse depth alone.
template <typename T>
struct DepthFlow {
  T x, y;  ///< [px unit]
};

template <typename Scalar, typename T>
DSORB_ALWAYS_INLINE DepthFlow<T> depthFlow(const Warp<Scalar>& w, const WarpedPoint<T>& p) {
  return {w.fx * p.inverse_z * (w.t[0] - p.u * w.t[2]),
          w.fy * p.inverse_z * (w.t[1] - p.v * w.t[2])};
}

/// Derivatives of the pixel (x, y), one row each, by a left increment [translation; rotation] of
/// the target's pose and by the inverse depth. x[1] and y[0] are zero.
template <typename T>
struct PixelJacobian {
  T x[6], y[6];
  DepthFlow<T> depth;
};

template <typename Scalar, typename T, typename Depth>
DSORB_ALWAYS_INLINE PixelJacobian<T> pixelJacobian(const Warp<Scalar>& w,
                                                   const WarpedPoint<T>& p,
                                                   const Depth& rho) {
  const T fx_rho = w.fx * rho * p.inverse_z;
  const T fy_rho = w.fy * rho * p.inverse_z;
  const T uv = p.u * p.v;
  PixelJacobian<T> J;
  J.x[1] = J.y[0] = spread<T>(Scalar{0});
  J.x[0] = fx_rho;
  J.x[2] = -fx_rho * p.u;
  J.x[3] = -w.fx * uv;
  J.x[4] = w.fx + w.fx * p.u * p.u;
  J.x[5] = -w.fx * p.v;
  J.y[1] = fy_rho;
  J.y[2] = -fy_rho * p.v;
  J.y[3] = -w.fy - w.fy * p.v * p.v;
  J.y[4] = w.fy * uv;
  J.y[5] = w.fy * p.u;
  J.depth = depthFlow(w, p);
  return J;
}

/// An image gradient in units of the ray: (gx, gy) = (fx dI/dx, fy dI/dy) [grey levels], and what
/// products with it share.
template <typename T>
struct RayGradient {
  T x, y;
  T radial;  ///< u gx + v gy
};

template <typename Scalar, typename T>
DSORB_ALWAYS_INLINE RayGradient<T> rayGradient(const Warp<Scalar>& w,
                                               const WarpedPoint<T>& p,
                                               const T& dx,
                                               const T& dy) {
  const T x = dx * w.fx;
  const T y = dy * w.fy;
  return {x, y, p.u * x + p.v * y};
}

/// The gradient times the rows of pixelJacobian(): derivatives of the intensity by the pose ...
/// @param target_rho inverse depth in the target, rho p.inverse_z
/// @param J          6 of them
template <typename T>
DSORB_ALWAYS_INLINE void poseJacobian(const WarpedPoint<T>& p,
                                      const RayGradient<T>& g,
                                      const T& target_rho,
                                      T* J) {
  J[0] = target_rho * g.x;
  J[1] = target_rho * g.y;
  J[2] = -target_rho * g.radial;
  J[3] = -g.y - p.v * g.radial;
  J[4] = g.x + p.u * g.radial;
  J[5] = p.u * g.y - p.v * g.x;
}

/// ... and by the inverse depth.
template <typename Scalar, typename T>
DSORB_ALWAYS_INLINE T depthJacobian(const Warp<Scalar>& w,
                                    const WarpedPoint<T>& p,
                                    const RayGradient<T>& g) {
  return p.inverse_z * (g.x * w.t[0] + g.y * w.t[1] - g.radial * w.t[2]);
}

/// The border rule of sampling.h spread over lanes: closer to the border the nearest position
/// inside is read.
template <typename T>
struct SampleArea {
  T min, max_x, max_y;  ///< [px], included
};

template <typename T>
DSORB_ALWAYS_INLINE SampleArea<T> sampleArea(int width, int height) {
  return {spread<T>(kNearBorder), spread<T>(lastSample(width)), spread<T>(lastSample(height))};
}

/// A position moved to the nearest one inside; NaN becomes the border, too.
template <typename T>
struct SamplePosition {
  T x, y;
  MaskOf<T> inside;  ///< not moved
};

template <typename T>
DSORB_ALWAYS_INLINE SamplePosition<T> clampToArea(const SampleArea<T>& area,
                                                  const WarpedPoint<T>& p) {
  const T low_x = p.x > area.min ? p.x : area.min;
  const T low_y = p.y > area.min ? p.y : area.min;
  const T x = low_x < area.max_x ? low_x : area.max_x;
  const T y = low_y < area.max_y ? low_y : area.max_y;
  const MaskOf<T> inside = (p.x == x) & (p.y == y);
  return {x, y, inside};
}

/// Pixel of a hosted point in another camera with its derivatives.
struct HostedProjection {
  Eigen::Vector2d pixel;               ///< [px]
  Eigen::Matrix<double, 2, 6> J_pose;  ///< of a left increment, [translation; rotation]
  Eigen::Vector2d J_inverse_depth;     ///< [px unit]
};

/// One point alone.
/// @param T_cam_host maps host to camera coordinates
/// @param host_ray   ray with z = 1
/// @param rho        inverse depth in the host [1/unit]
/// @return           nullopt unless the point lies in front of the camera
inline std::optional<HostedProjection> projectHosted(const PinholeCamera& camera,
                                                     const SE3& T_cam_host,
                                                     const Eigen::Vector3d& host_ray,
                                                     double rho) {
  const auto warp = makeWarp<double>(camera, T_cam_host);
  const WarpedPoint<double> p = warpPoint(warp, host_ray.x(), host_ray.y(), rho);
  if (!p.front) return std::nullopt;
  const PixelJacobian<double> J = pixelJacobian(warp, p, rho);
  HostedProjection out;
  out.pixel = {p.x, p.y};
  out.J_pose << Eigen::Map<const Eigen::RowVector<double, 6>>(J.x),
      Eigen::Map<const Eigen::RowVector<double, 6>>(J.y);
  out.J_inverse_depth = {J.depth.x, J.depth.y};
  return out;
}

}  // namespace dsorb
