// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/camera/pinhole_camera.h"

#include <gtest/gtest.h>

namespace dsorb {
namespace {

constexpr PinholeCamera kCamera{520, 510, 319.5, 239.5, 640, 480};

TEST(PinholeCameraTest, UnprojectInvertsProject) {
  for (double u = 0; u < 640; u += 31.7) {
    for (double v = 0; v < 480; v += 23.3) {
      const Eigen::Vector3d point = 3.7 * kCamera.unproject({u, v});
      EXPECT_NEAR((kCamera.project(point) - Eigen::Vector2d(u, v)).norm(), 0, 1e-9);
    }
  }
}

TEST(PinholeCameraTest, LevelsKeepPixelCentres) {
  const PinholeCamera half = kCamera.atLevel(1);
  EXPECT_DOUBLE_EQ(half.cx, (kCamera.cx + 0.5) / 2 - 0.5);
  EXPECT_EQ(half.width, 320);
  // The centre of a level-1 pixel is the mean of the centres of its 2 x 2 level-0 pixels.
  const Eigen::Vector3d ray = kCamera.unproject({10.5, 20.5});
  EXPECT_NEAR((half.project(ray) - Eigen::Vector2d(5, 10)).norm(), 0, 1e-12);
}

TEST(PinholeCameraTest, ContainsRespectsTheBorder) {
  EXPECT_TRUE(kCamera.contains({0, 0}));
  EXPECT_TRUE(kCamera.contains({639, 479}));
  EXPECT_FALSE(kCamera.contains({639.1, 479}));
  EXPECT_FALSE(kCamera.contains({3, 10}, 3.5));
}

}  // namespace
}  // namespace dsorb
