// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/geometry/se3.h"
#include "dsorb/image/affine_brightness.h"
#include "dsorb/image/frame.h"

#include "base/random.h"

#include <Eigen/LU>

#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

namespace dsorb {

/// A slanted textured plane seen by any camera, exact to the last digit: grey values are a sum of
/// waves over the reference image, moved by the plane's homography.
class PlaneScene {
 public:
  /// @param scale of the image's sides, 1: 320 x 240
  explicit PlaneScene(std::uint64_t seed, int scale = 1)
      : camera_{200.0 * scale,
                200.0 * scale,
                160.0 * scale - 0.5,
                120.0 * scale - 0.5,
                320 * scale,
                240 * scale} {
    Random random(seed);
    for (Wave& wave : waves_) {
      const double length = random.uniform(8, 40);  // [px]
      const double angle = random.uniform(0, M_PI);
      wave = {2 * M_PI * std::cos(angle) / length,
              2 * M_PI * std::sin(angle) / length,
              random.uniform(0, 2 * M_PI)};
    }
  }

  [[nodiscard]] const PinholeCamera& camera() const { return camera_; }
  /// Inverse depth of a pixel of the reference; the mean over the image is about 1.
  [[nodiscard]] double inverseDepth(const Eigen::Vector2d& pixel) const {
    return normal_.dot(camera_.unproject(pixel));
  }
  /// @param noise standard deviation [grey levels]
  /// @param brightness of the image relative to the scene
  [[nodiscard]] FramePtr render(const SE3& T_cam_ref,
                                double noise,
                                int id,
                                const BrightnessTransfer& brightness = {}) const {
    const Eigen::Matrix3d K = camera_.matrix();
    const Eigen::Matrix3d H_ref_cam =
        (K * (T_cam_ref.rotationMatrix() + T_cam_ref.translation() * normal_.transpose()) *
         K.inverse())
            .inverse();
    Random random(static_cast<std::uint64_t>(id) + 1000);
    std::vector<float> grey;
    for (int y = 0; y < camera_.height; ++y) {
      for (int x = 0; x < camera_.width; ++x) {
        const Eigen::Vector2d at = (H_ref_cam * Eigen::Vector3d(x, y, 1)).hnormalized();
        grey.push_back(static_cast<float>(brightness.gain * texture(at) + brightness.offset +
                                          (noise > 0 ? noise * random.gaussian() : 0)));
      }
    }
    return Frame::create(ImageView(grey.data(), camera_.width, camera_.height),
                         {FrameId{id}, 0.1 * id});
  }

 private:
  struct Wave {
    double kx = 0;
    double ky = 0;
    double phase = 0;
  };
  [[nodiscard]] double texture(const Eigen::Vector2d& at) const {
    double grey = 128;
    for (const Wave& wave : waves_) {
      grey += 9 * std::sin(wave.kx * at.x() + wave.ky * at.y() + wave.phase);
    }
    return grey;
  }

  PinholeCamera camera_;
  Eigen::Vector3d normal_{0.3, -0.2, 1.0};
  std::array<Wave, 16> waves_;
};

/// Pose of a camera that moved by x, y, z and turned about all axes, mostly the second.
inline SE3 poseOf(double x, double y, double z, double turn) {
  Vector6d xi;
  xi << x, y, z, 0.3 * turn, turn, -0.5 * turn;
  return SE3::exp(xi);
}

}  // namespace dsorb
