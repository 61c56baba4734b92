// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/geometry/se3.h"

#include "base/random.h"

#include <gtest/gtest.h>

namespace dsorb {
namespace {

Vector6d randomTwist(Random& random, double rotation_scale) {
  Vector6d xi;
  for (int i = 0; i < 6; ++i) xi[i] = random.uniform(-1, 1) * (i < 3 ? 2.0 : rotation_scale);
  return xi;
}

TEST(Se3Test, LogInvertsExpAtAllAngles) {
  Random random(1);
  for (const double scale : {0.0, 1e-9, 1e-5, 1e-4, 1e-3, 0.1, 1.0, 1.7}) {
    for (int i = 0; i < 50; ++i) {
      const Vector6d xi = randomTwist(random, scale);
      EXPECT_NEAR((SE3::exp(xi).log() - xi).norm(), 0, 1e-12) << "rotation scale " << scale;
    }
  }
}

TEST(Se3Test, GroupLaws) {
  Random random(2);
  for (int i = 0; i < 100; ++i) {
    const SE3 a = SE3::exp(randomTwist(random, 1.5));
    const SE3 b = SE3::exp(randomTwist(random, 1.5));
    const Eigen::Vector3d p{random.uniform(), random.uniform(), random.uniform()};
    EXPECT_NEAR(((a * b) * p - a * (b * p)).norm(), 0, 1e-12);
    EXPECT_NEAR((a.inverse() * (a * p) - p).norm(), 0, 1e-12);
    EXPECT_NEAR(((a * b).matrix() - a.matrix() * b.matrix()).norm(), 0, 1e-12);
    EXPECT_NEAR((SE3::fromMatrix(a.matrix()) * p - a * p).norm(), 0, 1e-12);
  }
}

TEST(Se3Test, AdjointMovesIncrementsAcross) {
  Random random(3);
  for (int i = 0; i < 100; ++i) {
    const SE3 T = SE3::exp(randomTwist(random, 1.5));
    const Vector6d xi = 0.3 * randomTwist(random, 1.0);
    const Eigen::Matrix4d left = (T * SE3::exp(xi)).matrix();
    const Eigen::Matrix4d right = (SE3::exp(T.adjoint() * xi) * T).matrix();
    EXPECT_NEAR((left - right).norm(), 0, 1e-11);
  }
}

TEST(Se3Test, ExpIsDerivativeOfFlow) {
  // exp(s xi) exp(t xi) = exp((s + t) xi) fails for any wrong left Jacobian.
  Random random(4);
  for (int i = 0; i < 100; ++i) {
    const Vector6d xi = randomTwist(random, 0.7);
    const Eigen::Matrix4d split = (SE3::exp(0.3 * xi) * SE3::exp(0.7 * xi)).matrix();
    EXPECT_NEAR((split - SE3::exp(xi).matrix()).norm(), 0, 1e-12);
  }
}

}  // namespace
}  // namespace dsorb
