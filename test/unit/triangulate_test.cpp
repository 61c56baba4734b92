// SPDX-License-Identifier: BSD-3-Clause
#include "geometry/triangulate.h"

#include "support/two_view_scene.h"

#include <gtest/gtest.h>

namespace dsorb {
namespace {

Eigen::Vector2d targetPoint(const TwoViewScene& scene, std::size_t i) {
  return scene.camera.unproject(scene.matches.target[i]).head<2>();
}

TEST(Triangulate, RecoversExactInverseDepth) {
  const TwoViewScene scene = makeTwoViewScene({}, 1);
  for (std::size_t i = 0; i < scene.matches.size(); ++i) {
    const auto point = triangulateInverseDepth(scene.T_cur_ref,
                                               scene.camera.unproject(scene.matches.reference[i]),
                                               targetPoint(scene, i),
                                               1.0 / scene.camera.fx);
    ASSERT_TRUE(point);
    EXPECT_NEAR(point->inverse_depth, scene.inverse_depth[i], 1e-10);
  }
}

TEST(Triangulate, PointAtInfinityHasInverseDepthZero) {
  const SE3 T_cur_ref(so3Exp({0.1, 0.2, -0.1}), Eigen::Vector3d(1, 0.2, 0.1));
  const Eigen::Vector3d ray(0.1, -0.2, 1);
  const Eigen::Vector3d turned = T_cur_ref.unitQuaternion() * ray;
  const auto point = triangulateInverseDepth(T_cur_ref, ray, turned.hnormalized(), 1e-3);
  ASSERT_TRUE(point);
  EXPECT_NEAR(point->inverse_depth, 0, 1e-12);
}

TEST(Triangulate, SaysNothingWithoutTranslationOrAtTheEpipole) {
  const Eigen::Vector3d ray(0.1, -0.2, 1);
  EXPECT_FALSE(triangulateInverseDepth(SE3(), ray, ray.head<2>(), 1e-3));
  const SE3 forward(Eigen::Quaterniond::Identity(), Eigen::Vector3d(0, 0, -1));
  EXPECT_FALSE(triangulateInverseDepth(forward, {0, 0, 1}, {0, 0}, 1e-3));
}

TEST(Triangulate, VarianceIsThatOfTheError) {
  // Normalised error of 20000 noisy measurements of points with parallax; measured 1.00.
  const TwoViewScene scene = makeTwoViewScene({}, 2);
  Random random(3);
  const double sigma = 0.3 / scene.camera.fx;
  double sum = 0;
  const int rounds = 20000;
  for (int round = 0; round < rounds; ++round) {
    const std::size_t i = static_cast<std::size_t>(round) % scene.matches.size();
    const Eigen::Vector2d noise{random.gaussian(), random.gaussian()};
    const auto point = triangulateInverseDepth(scene.T_cur_ref,
                                               scene.camera.unproject(scene.matches.reference[i]),
                                               targetPoint(scene, i) + sigma * noise,
                                               sigma);
    ASSERT_TRUE(point);
    const double error = point->inverse_depth - scene.inverse_depth[i];
    sum += error * error / point->variance;
  }
  EXPECT_NEAR(sum / rounds, 1, 0.05);
}

TEST(Triangulate, ParallaxIsTheAngleBetweenTheRaysInSpace) {
  // Two cameras 2 apart, the point 1 ahead of the middle: 90 degrees; the target is turned too.
  const Eigen::Quaterniond turn = so3Exp({0.3, -0.2, 0.5});
  const SE3 T_cur_ref(turn, turn * Eigen::Vector3d(-2, 0, 0));
  const Eigen::Vector3d point(1, 0, 1);
  EXPECT_NEAR(parallaxAngle(T_cur_ref, point, T_cur_ref * point), M_PI / 2, 1e-12);
}

}  // namespace
}  // namespace dsorb
