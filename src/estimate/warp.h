// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/geometry/se3.h"

#include "base/lanes.h"
#include "estimate/sampling.h"

#include <Eigen/Core>

#include <optional>
#include <type_traits>
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

/// The same number in all lanes.
template <typename T, typename Scalar>
DSORB_ALWAYS_INLINE void spread(Scalar value, T& lanes) {
  if constexpr (std::is_arithmetic_v<T>) {
    lanes = static_cast<T>(value);
  } else {
    fill(value, lanes);
  }
}

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
DSORB_ALWAYS_INLINE void warpPoint(
    const Warp<Scalar>& w, const T& ray_x, const T& ray_y, const Depth& rho, WarpedPoint<T>& out) {
  const T px = w.R[0] * ray_x + w.R[1] * ray_y + (w.R[2] + rho * w.t[0]);
  const T py = w.R[3] * ray_x + w.R[4] * ray_y + (w.R[5] + rho * w.t[1]);
  const T pz = w.R[6] * ray_x + w.R[7] * ray_y + (w.R[8] + rho * w.t[2]);
  T min_z;
  spread(static_cast<Scalar>(kMinWarpZ), min_z);
  out.front = pz > min_z;
  out.inverse_z = Scalar{1} / (out.front ? pz : min_z);
  out.u = px * out.inverse_z;
  out.v = py * out.inverse_z;
  out.x = w.fx * out.u + w.cx;
  out.y = w.fy * out.v + w.cy;
}

/// Derivatives of the pixel by the inverse depth alone [px unit].
template <typename Scalar, typename T>
DSORB_ALWAYS_INLINE void depthFlow(const Warp<Scalar>& w,
                                   const WarpedPoint<T>& p,
                                   T& flow_x,
                                   T& flow_y) {
  flow_x = w.fx * p.inverse_z * (w.t[0] - p.u * w.t[2]);
  flow_y = w.fy * p.inverse_z * (w.t[1] - p.v * w.t[2]);
}

/// Derivatives of the pixel (x, y), one row each, by a left increment [translation; rotation] of
/// the target's pose and by the inverse depth. x[1] and y[0] are zero.
template <typename T>
struct PixelJacobian {
  T x[6], y[6];
  T depth_x, depth_y;  ///< [px unit]
};

template <typename Scalar, typename T, typename Depth>
DSORB_ALWAYS_INLINE void pixelJacobian(const Warp<Scalar>& w,
                                       const WarpedPoint<T>& p,
                                       const Depth& rho,
                                       PixelJacobian<T>& J) {
  const T fx_rho = w.fx * rho * p.inverse_z;
  const T fy_rho = w.fy * rho * p.inverse_z;
  const T uv = p.u * p.v;
  spread(Scalar{0}, J.x[1]);
  spread(Scalar{0}, J.y[0]);
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
  depthFlow(w, p, J.depth_x, J.depth_y);
}

/// An image gradient in units of the ray: (gx, gy) = (fx dI/dx, fy dI/dy) [grey levels], and what
/// products with it share.
template <typename T>
struct RayGradient {
  T x, y;
  T radial;  ///< u gx + v gy
};

template <typename Scalar, typename T>
DSORB_ALWAYS_INLINE void rayGradient(
    const Warp<Scalar>& w, const WarpedPoint<T>& p, const T& dx, const T& dy, RayGradient<T>& g) {
  g.x = dx * w.fx;
  g.y = dy * w.fy;
  g.radial = p.u * g.x + p.v * g.y;
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
DSORB_ALWAYS_INLINE void depthJacobian(const Warp<Scalar>& w,
                                       const WarpedPoint<T>& p,
                                       const RayGradient<T>& g,
                                       T& J) {
  J = p.inverse_z * (g.x * w.t[0] + g.y * w.t[1] - g.radial * w.t[2]);
}

/// The border rule of sampling.h spread over lanes: closer to the border the nearest position
/// inside is read.
template <typename T>
struct SampleArea {
  T min, max_x, max_y;  ///< [px], included
};

template <typename T>
DSORB_ALWAYS_INLINE void sampleArea(int width, int height, SampleArea<T>& area) {
  spread(kNearBorder, area.min);
  spread(lastSample(width), area.max_x);
  spread(lastSample(height), area.max_y);
}

/// A position moved to the nearest one inside; NaN becomes the border, too.
template <typename T>
struct SamplePosition {
  T x, y;
  MaskOf<T> inside;  ///< not moved
};

template <typename T>
DSORB_ALWAYS_INLINE void clampToArea(const SampleArea<T>& area,
                                     const WarpedPoint<T>& p,
                                     SamplePosition<T>& at) {
  const T low_x = p.x > area.min ? p.x : area.min;
  const T low_y = p.y > area.min ? p.y : area.min;
  at.x = low_x < area.max_x ? low_x : area.max_x;
  at.y = low_y < area.max_y ? low_y : area.max_y;
  at.inside = (p.x == at.x) & (p.y == at.y);
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
  WarpedPoint<double> p;
  warpPoint(warp, host_ray.x(), host_ray.y(), rho, p);
  if (!p.front) return std::nullopt;
  PixelJacobian<double> J;
  pixelJacobian(warp, p, rho, J);
  HostedProjection out;
  out.pixel = {p.x, p.y};
  out.J_pose << Eigen::Map<const Eigen::RowVector<double, 6>>(J.x),
      Eigen::Map<const Eigen::RowVector<double, 6>>(J.y);
  out.J_inverse_depth = {J.depth_x, J.depth_y};
  return out;
}

}  // namespace dsorb
