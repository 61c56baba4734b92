// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/geometry/se3.h"
#include "dsorb/image/frame.h"

#include "image/photometric.h"

#include <Eigen/Geometry>

#include <array>
#include <cmath>
#include <vector>

namespace dsorb {

/// A tilted plane with a smooth texture (sum of sines), seen without aliasing: intensity and
/// inverse depth are exact at every pixel.
class TexturedPlane {
 public:
  /// Inverse depth of the plane on a camera's ray (z = 1) [1/unit]; the plane is about 2 units
  /// ahead.
  [[nodiscard]] double inverseDepth(const SE3& T_world_cam, const Eigen::Vector3d& ray) const {
    const Eigen::Vector3d normal = kNormal.normalized();
    const Eigen::Vector3d direction = T_world_cam.unitQuaternion() * ray;
    return normal.dot(direction) / (kDistance - normal.dot(T_world_cam.translation()));
  }

  /// Grey level at a pixel position.
  [[nodiscard]] double intensity(const SE3& T_world_cam, const Eigen::Vector3d& ray) const {
    const Eigen::Vector3d point = T_world_cam * (ray / inverseDepth(T_world_cam, ray));
    double value = 128;
    for (const Wave& wave : kWaves) {
      value += wave.amplitude * std::sin(wave.x * point.x() + wave.y * point.y() + wave.phase);
    }
    return value;
  }

  /// @param affine, exposure change the grey levels to exposure e^a I + b
  [[nodiscard]] FramePtr render(const PinholeCamera& camera,
                                const SE3& T_world_cam,
                                const FrameInfo& info,
                                const AffineBrightness& affine = {}) const {
    std::vector<float> image;
    image.reserve(static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height));
    const double gain = info.exposure * std::exp(affine.a);
    for (int y = 0; y < camera.height; ++y) {
      for (int x = 0; x < camera.width; ++x) {
        const Eigen::Vector3d ray = camera.unproject({x, y});
        image.push_back(static_cast<float>(gain * intensity(T_world_cam, ray) + affine.b));
      }
    }
    return Frame::create(ImageView(image.data(), camera.width, camera.height), info);
  }

  /// True inverse depths on a grid of pixels. @param offset moves them off the pixel centres [px]
  [[nodiscard]] std::vector<DepthSample> samples(const PinholeCamera& camera,
                                                 const SE3& T_world_cam,
                                                 int spacing,
                                                 float offset = 0) const {
    std::vector<DepthSample> samples;
    for (int y = 4; y < camera.height - 4; y += spacing) {
      for (int x = 4; x < camera.width - 4; x += spacing) {
        const Eigen::Vector2f pixel(static_cast<float>(x) + offset, static_cast<float>(y) + offset);
        const double rho = inverseDepth(T_world_cam, camera.unproject(pixel.cast<double>()));
        samples.push_back({pixel, static_cast<float>(rho), 1.0F});
      }
    }
    return samples;
  }

 private:
  struct Wave {
    double amplitude;
    double x, y;  // [rad / unit]
    double phase;
  };
  static constexpr std::array<Wave, 5> kWaves = {{{30, 7, 2.5, 0.3},
                                                  {25, -3, 6.5, 1.1},
                                                  {20, 11, -8.5, 2.0},
                                                  {12, 15.5, 12, 0.7},
                                                  {15, 1.5, -2, 2.9}}};
  inline static const Eigen::Vector3d kNormal{0.2, -0.1, 1.0};
  static constexpr double kDistance = 2.0;
};

/// A camera for it: 160 x 128 pixels, four pyramid levels.
inline PinholeCamera smallCamera() {
  return {150, 152, 79.2, 63.7, 160, 128};
}

}  // namespace dsorb
