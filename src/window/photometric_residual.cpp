// SPDX-License-Identifier: BSD-3-Clause
#include "window/photometric_residual.h"

#include "base/target_clones.h"
#include "estimate/robust_loss.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace dsorb::window {
namespace {

/// Derivatives of the target's pixel by the host's, times -1 [-].
struct RayJacobian {
  float xx, xy, yx, yy;
};

DSORB_ALWAYS_INLINE void rayJacobian(const Warp<float>& warp,
                                     const WarpedPoint<float>& p,
                                     RayJacobian& J) {
  const float* R = warp.R;
  const float fx_over_fy = warp.fx / warp.fy;
  J.xx = (R[6] * p.u - R[0]) * p.inverse_z;
  J.xy = fx_over_fy * (R[7] * p.u - R[1]) * p.inverse_z;
  J.yx = (R[6] * p.v - R[3]) * p.inverse_z / fx_over_fy;
  J.yy = (R[7] * p.v - R[4]) * p.inverse_z;
}

/// Shifts of a projected pixel by fx, fy, cx, cy and the radial distortion, for a ray that stays:
/// as shifts of the pixel of a pinhole camera.
std::array<Eigen::Vector2f, 5> lensShifts(const Eigen::Vector2f& ray,
                                          const Warp<float>& warp,
                                          float radial) {
  const Eigen::Vector2f focal(warp.fx, warp.fy);
  const float squared = ray.squaredNorm();
  const Eigen::Vector2f bent = ray * (1 + radial * squared);
  std::array<Eigen::Vector2f, 5> shifts{Eigen::Vector2f(bent.x() / warp.fx, 0),
                                        Eigen::Vector2f(0, bent.y() / warp.fy),
                                        Eigen::Vector2f(1 / warp.fx, 0),
                                        Eigen::Vector2f(0, 1 / warp.fy),
                                        ray * squared};
  for (Eigen::Vector2f& shift : shifts) {
    shift = focal.cwiseProduct(unbendShift(radial, ray, shift));
  }
  return shifts;
}

/// A lens enters twice: in the host's ray and in the target's projection.
void addLens(const Eigen::Vector2f& ray,
             const PairGeometry& pair,
             const WarpedPoint<float>& p,
             bool estimates_radial,
             ResidualGeometry& geometry) {
  const float radial = pair.current.shutter.radial;
  RayJacobian by_ray;
  rayJacobian(pair.first, p, by_ray);
  const auto host = lensShifts(ray, pair.first, radial);
  const auto target = lensShifts({p.u, p.v}, pair.first, radial);
  const auto add = [&](std::size_t i, std::size_t lane, double scale) {
    const auto factor = static_cast<float>(scale);
    geometry.x[lane] = factor * (target[i].x() + by_ray.xx * host[i].x() + by_ray.xy * host[i].y());
    geometry.y[lane] = factor * (target[i].y() + by_ray.yx * host[i].x() + by_ray.yy * host[i].y());
  };
  for (std::size_t i = 0; i < kIntrinsicsDim; ++i) add(i, kLaneCamera + i, kCameraScale);
  if (estimates_radial) add(kIntrinsicsDim, kLaneCamera + kRadial, kRadialScale);
}

/// Velocity of a point on the image plane z = 1 [1/s] at a time.
/// @param forth from the middle row to another; else back
Eigen::Vector2f velocityAt(
    const RollingShutter& shutter, const Eigen::Vector2f& ray, float rho, float time, bool forth) {
  RowFlow<float> flow;
  rowFlow(shutter, {ray.x(), ray.y()}, rho, forth, flow);
  const float sign = forth ? 1.0F : -1.0F;
  const float t = sign * time;
  const auto moved = [&](int i) { return t * (flow.first[i] + 0.5F * t * flow.second[i]); };
  const auto speed = [&](int i) { return flow.first[i] + t * flow.second[i]; };
  const float scale = 1.0F / (1.0F + moved(2));
  const Eigen::Vector2f at((ray.x() + moved(0)) * scale, (ray.y() + moved(1)) * scale);
  return sign * scale * (Eigen::Vector2f(speed(0), speed(1)) - at * speed(2));
}

/// The readout enters twice: in the pixel of the host's middle row and in the row of the target
/// that sees the point. Rows passed in a row's time are left out.
void addReadout(const WindowPoint& point,
                const HostRays& rays,
                const PairGeometry& pair,
                const WarpedPoint<float>& p,
                ResidualGeometry& geometry) {
  constexpr auto kScale = static_cast<float>(kReadoutScale);
  const Warp<float>& warp = pair.first;
  const Eigen::Vector2f& seen = point.patch.seen;
  Eigen::Vector2f ray;
  rays.at(seen.x(), seen.y(), ray.x(), ray.y());
  float share = 0;
  rowShare(pair.host_shutter, seen.x(), seen.y(), share);
  const Eigen::Vector2f host =
      share *
      velocityAt(
          pair.host_shutter, ray, point.inverse_depth, pair.host_shutter.readout * share, false);
  rowShare(pair.current.shutter, p.x, p.y, share);
  const Eigen::Vector2f target = share * velocityAt(pair.current.shutter,
                                                    {p.u, p.v},
                                                    point.inverse_depth * p.inverse_z,
                                                    pair.current.shutter.readout * share,
                                                    true);
  RayJacobian by_ray;
  rayJacobian(warp, p, by_ray);
  const float moved_x = warp.fx * host.x();
  const float moved_y = warp.fy * host.y();
  geometry.x[kLaneReadout] =
      kScale * (warp.fx * target.x() - by_ray.xx * moved_x - by_ray.xy * moved_y);
  geometry.y[kLaneReadout] =
      kScale * (warp.fy * target.y() - by_ray.yx * moved_x - by_ray.yy * moved_y);
}

/// When the rows of the host and of the target are read that show the point. Derivatives need no
/// better time than that of the pixel moved on straight, at the speed of the middle row.
void addTimes(const WindowPoint& point,
              const PairGeometry& pair,
              const WarpedPoint<float>& p,
              ResidualGeometry& geometry) {
  const TargetImage& target = pair.current;
  RowFlow<float> flow;
  rowFlow(target.shutter, {p.u, p.v}, point.inverse_depth * p.inverse_z, true, flow);
  float time = 0;
  rowTime(target.shutter, p.x, p.y, time);
  const float* d = flow.first;
  const float x = p.x + time * target.warp.fx * (d[0] - p.u * d[2]);
  const float y = p.y + time * target.warp.fy * (d[1] - p.v * d[2]);
  rowTime(target.shutter, x, y, geometry.target_time);
  rowTime(pair.host_shutter, point.patch.seen.x(), point.patch.seen.y(), geometry.host_time);
  geometry.target_time *= static_cast<float>(kVelocityScale);
  geometry.host_time *= static_cast<float>(kVelocityScale);
}

/// The square of the mean of the roots of gradientWeight in host and target.
DSORB_ALWAYS_INLINE void meanWeights(const Lanes& squared_gradient,
                                     const Lanes& host_root,
                                     Lanes& weight) {
  constexpr float kC = 50.0F;
  Lanes root = squared_gradient + kC * kC;
  squareRoots(root);
  const Lanes mean = 0.5F * (kC / root + host_root);
  weight = mean * mean;
}

template <bool kRolling>
DSORB_ALWAYS_INLINE bool sumPatch(const WindowPoint& point,
                                  const HostRays& rays,
                                  const PairGeometry& pair,
                                  PatchSums& sums) {
  WarpedPattern pattern;
  warpPattern<kRolling>(pair.current, rays, point.patch.pixel, point.inverse_depth, pattern);
  if (!inAllLanes(pattern.inside)) return false;
  const LaneSamples& seen = pattern.seen;
  Lanes host;
  Lanes host_weight;
  Lanes residual;
  load(point.patch.grey.data(), host);
  load(point.patch.root_weight.data(), host_weight);
  patternResidual(pair.current, point.patch, seen, residual);

  const Lanes squared_gradient = seen.dx * seen.dx + seen.dy * seen.dy;
  Lanes weight;
  meanWeights(squared_gradient, host_weight, weight);
  Lanes huber;
  huberWeights(residual, huber);
  const Lanes w = weight * huber;
  Lanes energy;
  huberEnergies(residual, huber, w, energy);
  const Lanes wx = w * seen.dx;
  const Lanes wy = w * seen.dy;
  const Lanes wr = w * residual;
  const Lanes radiance = host - pair.host_offset_first;
  const Lanes wa = w * radiance;
  Lanes totals;
  sumLanes({energy,
            w * w * squared_gradient,
            wx * seen.dx,
            wx * seen.dy,
            wy * seen.dy,
            wx * radiance,
            wy * radiance,
            wx},
           totals);
  sums.energy = totals[0];
  if (!std::isfinite(sums.energy)) return false;
  sums.texture = totals[1];
  sums.xx = totals[2];
  sums.xy = totals[3];
  sums.yy = totals[4];
  sums.xa = totals[5];
  sums.ya = totals[6];
  sums.xb = totals[7];
  sumLanes({wy, wa * radiance, wa, w, wx * residual, wy * residual, wa * residual, wr}, totals);
  sums.yb = totals[0];
  sums.aa = totals[1];
  sums.ab = totals[2];
  sums.bb = totals[3];
  sums.xr = totals[4];
  sums.yr = totals[5];
  sums.ar = totals[6];
  sums.br = totals[7];
  return true;
}

DSORB_TARGET_CLONES bool sumGlobalPatch(const WindowPoint& point,
                                        const HostRays& rays,
                                        const PairGeometry& pair,
                                        PatchSums& sums) {
  return sumPatch<false>(point, rays, pair, sums);
}

DSORB_TARGET_CLONES bool sumRollingPatch(const WindowPoint& point,
                                         const HostRays& rays,
                                         const PairGeometry& pair,
                                         PatchSums& sums) {
  return sumPatch<true>(point, rays, pair, sums);
}

}  // namespace

bool evaluatePatch(const WindowPoint& point,
                   const HostRays& rays,
                   const PairGeometry& pair,
                   PatchSums& sums) {
  return pair.current.corrected ? sumRollingPatch(point, rays, pair, sums)
                                : sumGlobalPatch(point, rays, pair, sums);
}

bool evaluateGeometry(const WindowPoint& point,
                      const HostRays& rays,
                      const PairGeometry& pair,
                      EstimatedCamera camera,
                      ResidualGeometry& geometry) {
  float ray_x = 0;
  float ray_y = 0;
  rays.at(point.patch.pixel.x(), point.patch.pixel.y(), ray_x, ray_y);
  WarpedPoint<float> p;
  warpPoint(pair.first, ray_x, ray_y, point.inverse_depth, p);
  if (!p.front) return false;
  PixelJacobian<float> J;
  pixelJacobian(pair.first, p, point.inverse_depth, J);
  std::copy_n(J.x, kPoseRows, geometry.x);
  std::copy_n(J.y, kPoseRows, geometry.y);
  geometry.depth_x = J.depth_x;
  geometry.depth_y = J.depth_y;
  if (pair.current.corrected) addTimes(point, pair, p, geometry);
  if (camera.intrinsics) addLens({ray_x, ray_y}, pair, p, camera.radial, geometry);
  if (camera.readout) addReadout(point, rays, pair, p, geometry);
  return true;
}

}  // namespace dsorb::window
