// SPDX-License-Identifier: BSD-3-Clause
#include "estimate/warp.h"

#include "support/jacobian_check.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <type_traits>

namespace dsorb {
namespace {

const PinholeCamera kWarpCamera{400, 410, 319.5, 239.5, 640, 480};

SE3 somePose() {
  Vector6d xi;
  xi << 0.1, -0.05, 0.08, 0.02, -0.03, 0.04;
  return SE3::exp(xi);
}

template <typename T>
struct ScalarOf {
  using type = T;
};
template <>
struct ScalarOf<Lanes> {
  using type = float;
};
template <>
struct ScalarOf<DoubleLanes> {
  using type = double;
};

template <typename T>
constexpr int kCount = static_cast<int>(sizeof(T) / sizeof(typename ScalarOf<T>::type));

template <typename T>
double at(const T& lanes, int k) {
  if constexpr (std::is_arithmetic_v<T>) {
    return static_cast<double>(k == 0 ? lanes : 0);
  } else {
    return static_cast<double>(lanes[k]);
  }
}

/// A few points, another in every lane.
struct HostPoint {
  double x, y, rho;
};
HostPoint pointOf(int k) {
  return {0.3 - 0.1 * k, -0.2 + 0.05 * k, 0.2 + 0.3 * k};
}

template <typename T>
struct Points {
  T x, y, rho;
  Points() {
    using Scalar = typename ScalarOf<T>::type;
    Scalar values[3][8];
    for (int k = 0; k < 8; ++k) {
      const HostPoint point = pointOf(k);
      values[0][k] = static_cast<Scalar>(point.x);
      values[1][k] = static_cast<Scalar>(point.y);
      values[2][k] = static_cast<Scalar>(point.rho);
    }
    std::memcpy(&x, values[0], sizeof(T));
    std::memcpy(&y, values[1], sizeof(T));
    std::memcpy(&rho, values[2], sizeof(T));
  }
};

/// Pixel of a point after a step of pose and inverse depth, by the group and the camera alone.
Eigen::VectorXd pixelAt(int k, const Eigen::VectorXd& step) {
  const HostPoint point = pointOf(k);
  const SE3 pose = SE3::exp(Vector6d(step.head<6>())) * somePose();
  return kWarpCamera.project(pose * (Eigen::Vector3d(point.x, point.y, 1) / (point.rho + step[6])));
}

template <typename T>
class WarpOf : public testing::Test {
 protected:
  using Scalar = typename ScalarOf<T>::type;
  /// Largest error of values, and of derivatives relative to their norm.
  static constexpr double kTolerance = sizeof(Scalar) == sizeof(float) ? 2e-6 : 1e-8;

  Warp<Scalar> warp = makeWarp<Scalar>(kWarpCamera, somePose());
  Points<T> points;
  WarpedPoint<T> warped = warpPoint(warp, points.x, points.y, points.rho);

  [[nodiscard]] Eigen::MatrixXd numeric(int k) const {
    return numericJacobian([k](const Eigen::VectorXd& step) { return pixelAt(k, step); }, 7);
  }
};

using WarpTypes = testing::Types<float, double, Lanes, DoubleLanes>;
TYPED_TEST_SUITE(WarpOf, WarpTypes);

TYPED_TEST(WarpOf, ProjectsAsCameraAndPoseDo) {
  for (int k = 0; k < kCount<TypeParam>; ++k) {
    const Eigen::VectorXd expected = pixelAt(k, Eigen::VectorXd::Zero(7));
    EXPECT_NEAR(at(this->warped.x, k), expected[0], 640 * this->kTolerance);
    EXPECT_NEAR(at(this->warped.y, k), expected[1], 640 * this->kTolerance);
    const HostPoint point = pointOf(k);
    const Eigen::Vector3d p = somePose() * (Eigen::Vector3d(point.x, point.y, 1) / point.rho);
    EXPECT_NEAR(at(this->warped.inverse_z, k), 1 / (point.rho * p.z()), 10 * this->kTolerance);
  }
}

TYPED_TEST(WarpOf, PixelJacobianMatchesCentralDifferences) {
  const auto J = pixelJacobian(this->warp, this->warped, this->points.rho);
  for (int k = 0; k < kCount<TypeParam>; ++k) {
    Eigen::MatrixXd made(2, 7);
    for (int i = 0; i < 6; ++i) made.col(i) << at(J.x[i], k), at(J.y[i], k);
    made.col(6) << at(J.depth.x, k), at(J.depth.y, k);
    const Eigen::MatrixXd expected = this->numeric(k);
    EXPECT_LT(relativeDifference(made.leftCols(6), expected.leftCols(6)), this->kTolerance);
    EXPECT_LT(relativeDifference(made.col(6), expected.col(6)), this->kTolerance);
  }
}

TYPED_TEST(WarpOf, ContractedJacobiansMatchCentralDifferences) {
  const Eigen::RowVector2d gradient(3, -7);
  using Number = typename TestFixture::Scalar;
  const auto dx = spread<TypeParam>(static_cast<Number>(gradient[0]));
  const auto dy = spread<TypeParam>(static_cast<Number>(gradient[1]));
  const auto g = rayGradient(this->warp, this->warped, dx, dy);
  TypeParam J[6];
  poseJacobian(this->warped, g, this->points.rho * this->warped.inverse_z, J);
  const TypeParam J_depth = depthJacobian(this->warp, this->warped, g);
  for (int k = 0; k < kCount<TypeParam>; ++k) {
    Eigen::RowVectorXd made(7);
    for (int i = 0; i < 6; ++i) made[i] = at(J[i], k);
    made[6] = at(J_depth, k);
    const Eigen::RowVectorXd expected = gradient * this->numeric(k);
    EXPECT_LT(relativeDifference(made.head(6), expected.head(6)), this->kTolerance);
    EXPECT_LT(relativeDifference(made.tail(1), expected.tail(1)), 5 * this->kTolerance);
  }
}

TYPED_TEST(WarpOf, PointsBehindAreMarkedAndStayFinite) {
  auto turned = makeWarp<typename TestFixture::Scalar>(
      kWarpCamera, SE3(so3Exp({0, M_PI, 0}), Eigen::Vector3d(0, 0, 0)));
  const auto behind = warpPoint(turned, this->points.x, this->points.y, this->points.rho);
  for (int k = 0; k < kCount<TypeParam>; ++k) {
    EXPECT_EQ(at(behind.front, k), 0);
    EXPECT_NE(at(this->warped.front, k), 0);
    EXPECT_TRUE(std::isfinite(at(behind.x, k)));
  }
}

TEST(Warp, PositionsOutsideMoveToTheBorder) {
  const auto area = sampleArea<float>(640, 480);
  const auto moved = [&](float x, float y) {
    WarpedPoint<float> point{};
    point.x = x;
    point.y = y;
    return clampToArea(area, point);
  };
  EXPECT_TRUE(moved(1, 477.9F).inside);
  EXPECT_TRUE(moved(637, 1).inside);
  EXPECT_FALSE(moved(0.99F, 100).inside);
  EXPECT_FALSE(moved(638, 100).inside);
  EXPECT_EQ(moved(1e9F, -1e9F).x, lastSample(640));
  EXPECT_EQ(moved(1e9F, -1e9F).y, 1);
  const SamplePosition<float> lost = moved(std::numeric_limits<float>::quiet_NaN(), 100);
  EXPECT_FALSE(lost.inside);
  EXPECT_EQ(lost.x, 1);
}

TEST(Warp, OnePointAloneIsTheSame) {
  const HostPoint point = pointOf(0);
  const auto projection =
      projectHosted(kWarpCamera, somePose(), Eigen::Vector3d(point.x, point.y, 1), point.rho);
  ASSERT_TRUE(projection);
  EXPECT_LT((projection->pixel - pixelAt(0, Eigen::VectorXd::Zero(7))).norm(), 1e-10);
  const Eigen::MatrixXd expected =
      numericJacobian([](const Eigen::VectorXd& step) { return pixelAt(0, step); }, 7);
  EXPECT_LT(relativeDifference(projection->J_pose, expected.leftCols(6)), 1e-8);
  EXPECT_LT(relativeDifference(projection->J_inverse_depth, expected.col(6)), 1e-8);
  EXPECT_FALSE(
      projectHosted(kWarpCamera, SE3(Eigen::Matrix3d::Identity(), {0, 0, -2}), {0, 0, 1}, 1));
}

}  // namespace
}  // namespace dsorb
