// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/camera/row_times.h"
#include "dsorb/geometry/se3.h"
#include "dsorb/image/frame.h"

#include "base/lanes.h"
#include "estimate/radial.h"
#include "estimate/warp.h"
#include "geometry/row_motion.h"

#include <Eigen/Core>

#include <algorithm>
#include <cmath>
#include <optional>

/// Rolling shutter, and what a calibration lacks of a lens, by two corrections, so that everything
/// between them is geometry of a pinhole camera with a global shutter at the time of the middle
/// row: a pixel of the host is moved to where that would have seen it, and a projected point to the
/// row that saw it. To second order in the time; derivatives by poses and depths are those of the
/// global shutter.
/// @source time of the row by iteration: Schubert et al., Direct Sparse Odometry with Rolling
///         Shutter, ECCV 2018
namespace dsorb {

/// Motion of the rows of one image, for points in the camera coordinates of its middle row.
struct RollingShutter {
  float readout;           ///< [s]
  float share[10];         ///< RowTimes::share
  bool straight;           ///< only the first three of them count
  float scale_x, shift_x;  ///< pixels of the image to the coordinates of RowTimes
  float scale_y, shift_y;
  float velocity[6];  ///< of RowMotion
  /// Second derivatives by the time of a point times its inverse depth, rows of factors of
  /// (u, v, 1, inverse depth): from the middle row to another, and back.
  float forth[3][4], back[3][4];
  float radial = 0;  ///< of radial.h, applied last
};

/// d^2 / dt^2 of a point p rho, which moves by d / dt = w x p + rho v.
/// @param sign of the acceleration
inline void setCurvature(const RowMotion& motion, double sign, float (&rows)[3][4]) {
  const Eigen::Matrix3d W = hat(motion.velocity.tail<3>());
  Eigen::Matrix<double, 3, 4> factors;
  factors << W * W + sign * hat(motion.acceleration.tail<3>()),
      W * motion.velocity.head<3>() + sign * motion.acceleration.head<3>();
  for (int i = 0; i < 12; ++i) rows[i / 4][i % 4] = static_cast<float>(factors(i / 4, i % 4));
}

inline RollingShutter makeRollingShutter(const RowTimes& times,
                                         const RowMotion& motion,
                                         int level = 0) {
  RollingShutter shutter;
  shutter.readout = static_cast<float>(times.readout.seconds);
  for (std::size_t i = 0; i < times.share.size(); ++i) {
    shutter.share[i] = static_cast<float>(times.share[i]);
  }
  // A point that passes 10 px in the readout is .001 px off.
  constexpr double kNegligible = 1e-4;
  shutter.straight = std::all_of(times.share.begin() + 3, times.share.end(), [](double factor) {
    return std::abs(factor) < kNegligible / 7;
  });
  const auto size = static_cast<double>(1 << level);
  const auto coordinate = [size](int pixels, float& scale, float& shift) {
    const double unit = 2.0 / (pixels - 1);
    scale = static_cast<float>(unit * size);
    shift = static_cast<float>(unit * (0.5 * size - 0.5) - 1);
  };
  coordinate(times.width, shutter.scale_x, shutter.shift_x);
  coordinate(times.height, shutter.scale_y, shutter.shift_y);
  for (int i = 0; i < 6; ++i) shutter.velocity[i] = static_cast<float>(motion.velocity[i]);
  setCurvature(motion, 1, shutter.forth);
  setCurvature(motion, -1, shutter.back);
  return shutter;
}

/// Time of a pixel relative to the middle row, as a share of the readout. @tparam T float or Lanes
template <typename T>
DSORB_ALWAYS_INLINE T rowShare(const RollingShutter& s, const T& x, const T& y) {
  const T a = s.scale_x * x + s.shift_x;
  const T b = s.scale_y * y + s.shift_y;
  const float* c = s.share;
  if (s.straight) return c[0] + a * c[1] + b * c[2];
  return c[0] + a * (c[1] + a * (c[3] + a * c[6]) + b * (c[4] + a * c[7])) +
         b * (c[2] + b * (c[5] + a * c[8] + b * c[9]));
}

/// The same in seconds.
template <typename T>
DSORB_ALWAYS_INLINE T rowTime(const RollingShutter& s, const T& x, const T& y) {
  return s.readout * rowShare(s, x, y);
}

/// First and second derivative by the time of a point times its inverse depth, (u, v, 1).
template <typename T>
struct RowFlow {
  T first[3], second[3];
};

/// @param ray   (u, v) of (u, v, 1)
/// @param rho   inverse depth [1/unit]
/// @param forth from the middle row to another; else back
template <typename T, typename Depth>
DSORB_ALWAYS_INLINE RowFlow<T> rowFlow(const RollingShutter& s,
                                       const T (&ray)[2],
                                       const Depth& rho,
                                       bool forth) {
  const float* w = s.velocity + 3;
  const T& u = ray[0];
  const T& v = ray[1];
  RowFlow<T> flow;
  T* d = flow.first;
  d[0] = w[1] - w[2] * v + rho * s.velocity[0];
  d[1] = w[2] * u - w[0] + rho * s.velocity[1];
  d[2] = w[0] * v - w[1] * u + rho * s.velocity[2];
  const auto& rows = forth ? s.forth : s.back;
  for (int i = 0; i < 3; ++i) {
    flow.second[i] = rows[i][0] * u + rows[i][1] * v + (rows[i][2] + rho * rows[i][3]);
  }
  return flow;
}

/// Moves the pixel of a projected point to the row that sees it; u and v stay those of the middle
/// row.
/// @param rho inverse depth in the target [1/unit]
template <typename T>
DSORB_ALWAYS_INLINE void moveToRow(const RollingShutter& s,
                                   const Warp<float>& w,
                                   const T& rho,
                                   WarpedPoint<T>& p) {
  constexpr int kIterations = 2;  // each multiplies the error by the rows passed in a row's time
  const RowFlow<T> flow = rowFlow(s, {p.u, p.v}, rho, true);
  for (int i = 0; i < kIterations; ++i) {
    const T t = rowTime(s, p.x, p.y);
    const T half = 0.5F * t;
    const T nearer = t * (flow.first[2] + half * flow.second[2]);
    // Without a division where the pixel only tells the row.
    const T scale = i + 1 < kIterations ? 1.0F - nearer : 1.0F / (1.0F + nearer);
    T u = (p.u + t * (flow.first[0] + half * flow.second[0])) * scale;
    T v = (p.v + t * (flow.first[1] + half * flow.second[1])) * scale;
    if (s.radial != 0) bend(s.radial, u, v);
    p.x = w.fx * u + w.cx;
    p.y = w.fy * v + w.cy;
  }
}

/// Pixel that shows, in its own row, what a global shutter would have seen at another.
/// @param pixel         of level 0, at the time of the middle row
/// @param inverse_depth there [1/unit]
inline Eigen::Vector2f pixelInRow(const RollingShutter& s,
                                  const PinholeCamera& camera,
                                  const Eigen::Vector2f& pixel,
                                  float inverse_depth) {
  Warp<float> warp{};
  warp.setCamera(camera);
  WarpedPoint<float> p{};
  p.x = pixel.x();
  p.y = pixel.y();
  p.u = (p.x - warp.cx) / warp.fx;
  p.v = (p.y - warp.cy) / warp.fy;
  moveToRow(s, warp, inverse_depth, p);
  return {p.x, p.y};
}

/// Pixel at which a global shutter would have seen, at the time of the middle row, what a pixel
/// shows.
/// @param pixel         of level 0, in its own row
/// @param inverse_depth at the time of the middle row [1/unit]
inline Eigen::Vector2f pixelInMiddle(const RollingShutter& s,
                                     const PinholeCamera& camera,
                                     const Eigen::Vector2f& pixel,
                                     float inverse_depth) {
  const auto fx = static_cast<float>(camera.fx);
  const auto fy = static_cast<float>(camera.fy);
  const auto cx = static_cast<float>(camera.cx);
  const auto cy = static_cast<float>(camera.cy);
  const Eigen::Vector2f ideal = unbend(s.radial, {(pixel.x() - cx) / fx, (pixel.y() - cy) / fy});
  const float ray[2] = {ideal.x(), ideal.y()};
  const float t = rowTime(s, pixel.x(), pixel.y());
  RowFlow<float> flow = rowFlow(s, ray, inverse_depth, false);
  const auto moved = [&](int i) { return -t * (flow.first[i] - 0.5F * t * flow.second[i]); };
  flow = rowFlow(s, ray, inverse_depth * (1.0F + moved(2)), false);  // inverse depth in the row
  const float scale = 1.0F / (1.0F + moved(2));
  return {fx * (ray[0] + moved(0)) * scale + cx, fy * (ray[1] + moved(1)) * scale + cy};
}

/// Readout of the camera that took a frame, as it was calibrated.
inline Readout readoutOf(const Frame& frame) {
  return frame.rowTimes() == nullptr ? Readout{} : frame.rowTimes()->readout;
}

/// Whether the rows of a frame have different times, or may have them.
inline bool isRolling(const Frame& frame) {
  return readoutOf(frame).isRolling();
}

/// Row times of a frame that has them, with what an estimate adds to the calibrated readout.
/// @param change [s]
inline RowTimes rowTimesOf(const Frame& frame, double change) {
  RowTimes times = *frame.rowTimes();
  times.readout.seconds += change;
  return times;
}

/// What an estimate adds to the calibrated camera.
struct CameraChange {
  double readout = 0;  ///< [s]
  double radial = 0;   ///< of radial.h
};

/// How the rows of a frame move; nothing where the frame sees what a pinhole camera with a global
/// shutter would.
inline std::optional<RollingShutter> shutterOf(const Frame& frame,
                                               const RowMotion& motion,
                                               const CameraChange& change,
                                               int level = 0) {
  const bool rolling = isRolling(frame);
  if (!rolling && change.radial == 0) return std::nullopt;
  const RowTimes times = rolling ? rowTimesOf(frame, change.readout) : RowTimes{};
  RollingShutter shutter = makeRollingShutter(times, motion, level);
  shutter.radial = static_cast<float>(change.radial);
  return shutter;
}

}  // namespace dsorb
