// SPDX-License-Identifier: BSD-3-Clause
#include "base/random.h"
#include "track/pose_alignment.h"

#include <Eigen/LU>
#include <gtest/gtest.h>

namespace dsorb::track {
namespace {

PoseEquations someEquations() {
  Random random(3);
  Matrix8d J;
  for (int i = 0; i < 8; ++i) {
    for (int j = 0; j < 8; ++j) J(i, j) = random.gaussian();
  }
  PoseEquations equations;
  equations.H = 1e4 * J.transpose() * J;
  return equations;
}

TEST(TrackingCovariance, GrowsWithTheVarianceOfTheResidualsAndHasBrightnessFree) {
  const PoseEquations equations = someEquations();
  const auto free = trackingCovariance(equations, 1, SE3(), BrightnessModel::kUncalibrated);
  const auto noisy = trackingCovariance(equations, 9, SE3(), BrightnessModel::kUncalibrated);
  const auto fixed = trackingCovariance(equations, 1, SE3(), BrightnessModel::kPerfect);
  ASSERT_TRUE(free && noisy && fixed);
  EXPECT_TRUE(noisy->isApprox(9 * *free, 1e-9));
  const Eigen::Matrix<double, 6, 6> inverse = equations.H.inverse().topLeftCorner<6, 6>();
  EXPECT_TRUE(free->isApprox(inverse, 1e-6));
  const Eigen::Matrix<double, 6, 6> known = equations.H.topLeftCorner<6, 6>().inverse();
  EXPECT_TRUE(fixed->isApprox(known, 1e-6));
}

TEST(TrackingCovariance, TellsNoiseFromErrorsOfTheMap) {
  EXPECT_DOUBLE_EQ(varianceOfResiduals(2, 2), kResidualsPerNoise * 4);
  EXPECT_DOUBLE_EQ(varianceOfResiduals(3, 2), kResidualsPerNoise * 4 + kResidualsPerMapError * 5);
  EXPECT_DOUBLE_EQ(varianceOfResiduals(2, 2.5),
                   kResidualsPerNoise * 4);  // tails lighter than noise's
}

TEST(TrackingCovariance, TheUnknownScaleOfAMapIsAnErrorAlongTheTranslation) {
  const PoseEquations equations = someEquations();
  const Eigen::Vector3d t(0.3, -2, 5);
  const auto near = trackingCovariance(equations, 1e-9, SE3(), {});
  const auto far = trackingCovariance(equations, 1e-9, SE3(Eigen::Quaterniond::Identity(), t), {});
  ASSERT_TRUE(near && far);
  const Eigen::Matrix<double, 6, 6> difference = *far - *near;
  const double share = difference.trace() / t.squaredNorm();
  EXPECT_GT(share, 0);
  EXPECT_TRUE(difference.topLeftCorner(3, 3).isApprox(share * t * t.transpose(), 1e-9));
  EXPECT_NEAR(difference.bottomRows(3).norm(), 0, 1e-15);
}

TEST(TrackingCovariance, IsMissingWherePointsDoNotDetermineThePose) {
  PoseEquations equations = someEquations();
  equations.H.row(2).setZero();
  equations.H.col(2).setZero();
  EXPECT_FALSE(trackingCovariance(equations, 1, SE3(), {}));
  EXPECT_FALSE(trackingCovariance(PoseEquations{}, 1, SE3(), {}));
  equations.H.setConstant(std::numeric_limits<double>::quiet_NaN());
  EXPECT_FALSE(trackingCovariance(equations, 1, SE3(), {}));
}

}  // namespace
}  // namespace dsorb::track
