// SPDX-License-Identifier: BSD-3-Clause
#include "estimate/radial.h"

#include "estimate/rolling_shutter.h"
#include "support/jacobian_check.h"

#include <gtest/gtest.h>

#include <vector>

namespace dsorb {
namespace {

using Eigen::Vector2d;
using Eigen::Vector2f;
using Eigen::VectorXd;

const std::vector<float> kDistortions = {-0.28F, 0.2F};
const std::vector<Vector2f> kRays = {{0.05F, -0.1F}, {0.4F, 0.3F}, {-0.7F, 0.5F}};

Vector2d bent(double k, const Vector2d& ray) {
  return ray * (1 + k * ray.squaredNorm());
}

/// Derivative of what is seen by the ideal ray.
Eigen::Matrix2d derivative(float k, const Vector2f& ray) {
  return numericJacobian(
      [&](const VectorXd& d) {
        return VectorXd(bent(static_cast<double>(k), ray.cast<double>() + d));
      },
      2);
}

TEST(Radial, UnbendingIsTheInverseOfBending) {
  for (const float k : kDistortions) {
    for (const Vector2f& ray : kRays) {
      Vector2f seen = ray;
      bend(k, seen.x(), seen.y());
      EXPECT_LT((seen.cast<double>() - bent(static_cast<double>(k), ray.cast<double>())).norm(),
                1e-6);
      // Measured up to .0007 at the outermost ray: .3 px of a focal length of 500.
      EXPECT_LT((unbend(k, seen) - ray).norm(), 0.0015F) << k << " " << ray.transpose();
    }
  }
  EXPECT_EQ(unbend(0, kRays[2]), kRays[2]);
}

TEST(Radial, ShiftsAndGradientsAreThoseOfTheDerivative) {
  constexpr float kRatio = 0.9F;  // fy over fx
  const Vector2f shift(0.3F, -0.2F);
  for (const float k : kDistortions) {
    for (const Vector2f& ray : kRays) {
      const Eigen::Matrix2d J = derivative(k, ray);
      const Vector2d ideal = J.inverse() * shift.cast<double>();
      EXPECT_LT((unbendShift(k, ray, shift).cast<double>() - ideal).norm(), 1e-5);
      Vector2f gradient = shift;
      bendGradient(k, {ray.x(), ray.y()}, kRatio, gradient.x(), gradient.y());
      const Vector2d focal(1, static_cast<double>(kRatio));
      const Vector2d expected =
          (J.transpose() * shift.cast<double>().cwiseProduct(focal)).cwiseQuotient(focal);
      EXPECT_LT((gradient.cast<double>() - expected).norm(), 1e-5);
    }
  }
}

TEST(Radial, PixelsOfAFrameAreMovedToThoseOfAPinholeCameraAndBack) {
  const PinholeCamera camera{300, 290, 159.5, 119.5, 320, 240};
  const std::vector<float> image(320UL * 240UL, 40);
  const FramePtr frame =
      Frame::create(ImageView(image.data(), 320, 240), {FrameId{0}, 0, 0, nullptr});
  EXPECT_FALSE(shutterOf(*frame, {}, {}));
  const auto shutter = shutterOf(*frame, {}, {0, -0.2});
  ASSERT_TRUE(shutter);
  for (const Vector2f& seen : {Vector2f(160, 120), Vector2f(20, 200), Vector2f(318, 1)}) {
    const Vector2f ideal = pixelInMiddle(*shutter, camera, seen, 0.5F);
    // Measured up to 3e-4.
    EXPECT_LT((pixelInRow(*shutter, camera, ideal, 0.5F) - seen).norm(), 1e-3F);
    const Vector2d ray = camera.unproject(ideal.cast<double>()).head<2>();
    const Vector2d expected = camera.project(bent(-0.2, ray).homogeneous());
    EXPECT_LT((expected - seen.cast<double>()).norm(), 1e-3);
  }
}

}  // namespace
}  // namespace dsorb
