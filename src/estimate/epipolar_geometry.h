// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/geometry/se3.h"

#include <Eigen/Core>

namespace dsorb {

/// Pixels of one frame in another as a function of the inverse depth: A (x, y, 1) + rho b up to
/// scale; its z is the depth in the target over that in the host.
struct EpipolarGeometry {
  EpipolarGeometry(const PinholeCamera& camera, const SE3& T_target_host)
      : EpipolarGeometry(camera, camera, T_target_host) {}
  EpipolarGeometry(const PinholeCamera& host, const PinholeCamera& target, const SE3& T_target_host)
      : A((target.matrix() * T_target_host.rotationMatrix() * host.matrix().inverse())
              .cast<float>()),
        b((target.matrix() * T_target_host.translation()).cast<float>()) {}

  [[nodiscard]] Eigen::Vector3f atInfinity(const Eigen::Vector2f& pixel) const {
    return A * pixel.homogeneous();
  }
  [[nodiscard]] Eigen::Vector3f at(const Eigen::Vector2f& pixel, float inverse_depth) const {
    return atInfinity(pixel) + b * inverse_depth;
  }

  Eigen::Matrix3f A;  ///< K R K^-1
  Eigen::Vector3f b;  ///< K t
};

}  // namespace dsorb
