// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/cxx17.h"

#include <Eigen/Core>

namespace dsorb {

/// Rectified pinhole camera. The centre of the top-left pixel is (0, 0); depth is z, not range.
struct PinholeCamera {
  double fx = 0;   ///< focal length [px]
  double fy = 0;   ///< focal length [px]
  double cx = 0;   ///< principal point [px]
  double cy = 0;   ///< principal point [px]
  int width = 0;   ///< [px]
  int height = 0;  ///< [px]
  /// Relative standard deviation of the focal lengths where they are a guess, which the odometry
  /// then refines together with principal point and radial distortion; 0: a calibration.
  double focal_sigma = 0;

  /// Camera of images of which nothing is known: 65 degrees along the longer side, as phones,
  /// webcams and action cameras have them within a factor of two.
  [[nodiscard]] static PinholeCamera unknown(int width, int height) {
    constexpr double kFocalOfSide = 0.785;  // 1 / (2 tan(65 degrees / 2))
    const double focal = kFocalOfSide * (width > height ? width : height);
    return {focal, focal, 0.5 * (width - 1), 0.5 * (height - 1), width, height, 0.3};
  }

  /// @param point camera coordinates, z > 0
  [[nodiscard]] Eigen::Vector2d project(const Eigen::Vector3d& point) const {
    return {fx * point.x() / point.z() + cx, fy * point.y() / point.z() + cy};
  }
  /// @return ray through the pixel, scaled to z = 1
  [[nodiscard]] Eigen::Vector3d unproject(const Eigen::Vector2d& pixel) const {
    return {(pixel.x() - cx) / fx, (pixel.y() - cy) / fy, 1.0};
  }
  /// Camera of a pyramid level: f / 2^l, c = (c + 0.5) / 2^l - 0.5, sizes halved and floored.
  [[nodiscard]] PinholeCamera atLevel(int level) const {
    const double scale = 1.0 / static_cast<double>(1 << level);
    return {fx * scale,
            fy * scale,
            (cx + 0.5) * scale - 0.5,
            (cy + 0.5) * scale - 0.5,
            width >> level,
            height >> level};
  }
  /// Whether the pixel keeps at least `border` pixels from every outermost pixel centre.
  [[nodiscard]] bool contains(const Eigen::Vector2d& pixel, double border = 0) const {
    return pixel.x() >= border && pixel.y() >= border && pixel.x() <= width - 1 - border &&
           pixel.y() <= height - 1 - border;
  }
  /// [fx 0 cx; 0 fy cy; 0 0 1].
  [[nodiscard]] Eigen::Matrix3d matrix() const {
    Eigen::Matrix3d K;
    K << fx, 0, cx, 0, fy, cy, 0, 0, 1;
    return K;
  }
};

}  // namespace dsorb
