// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/thesis/geometric_adjustment.h"

#include "init/orb/bundle/robust_adjustment.h"
#include "init/orb/thesis/ceres/reprojection_cost.h"
#include "support/assign_map.h"
#include "support/jacobian_check.h"
#include "support/matchers.h"
#include "support/synthetic_map.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace dsorb::init_orb {
namespace {

using RowMajor2x7 = Eigen::Matrix<double, 2, 7, Eigen::RowMajor>;
using RowMajor6x7 = Eigen::Matrix<double, 6, 7, Eigen::RowMajor>;
using RowMajor7x6 = Eigen::Matrix<double, 7, 6, Eigen::RowMajor>;

SE3 somePose(std::uint64_t seed) {
  Random random(seed);
  Vector6d xi;
  for (int d = 0; d < 6; ++d) {
    xi[d] = random.uniform(-0.5, 0.5);
  }
  return SE3::exp(xi);
}

Eigen::Matrix2d someWhitening() {
  return (Eigen::Matrix2d() << 1.2, 0, 0.3, 0.9).finished();
}

TEST(PoseManifold, MinusUndoesPlus) {
  const PoseManifold manifold;
  const PoseBlock x = toBlock(somePose(1));
  Vector6d delta;
  delta << 0.3, -0.2, 0.1, 0.4, 0.5, -0.6;
  PoseBlock y{};
  Vector6d back;
  ASSERT_TRUE(manifold.Plus(x.data(), delta.data(), y.data()));
  ASSERT_TRUE(manifold.Minus(y.data(), x.data(), back.data()));
  EXPECT_LT((back - delta).norm(), 1e-12);
  EXPECT_THAT(fromBlock(y.data()), Se3Near(SE3::exp(delta) * somePose(1), 1e-10, 1e-12));
}

TEST(PoseManifold, JacobiansMatchCentralDifferencesAndInvertEachOther) {
  const PoseManifold manifold;
  const PoseBlock x = toBlock(somePose(2));
  RowMajor7x6 plus;
  RowMajor6x7 minus;
  ASSERT_TRUE(manifold.PlusJacobian(x.data(), plus.data()));
  ASSERT_TRUE(manifold.MinusJacobian(x.data(), minus.data()));
  const auto moved = [&](const Eigen::VectorXd& delta) {
    PoseBlock y{};
    manifold.Plus(x.data(), delta.data(), y.data());
    return Eigen::VectorXd(Eigen::Map<const Eigen::Matrix<double, 7, 1>>(y.data()));
  };
  EXPECT_LT(relativeDifference(plus, numericJacobian(moved, 6)), 1e-8);
  EXPECT_LT((minus * plus - Matrix6d::Identity()).norm(), 1e-12);
}

TEST(ReprojectionCost, JacobiansMatchCentralDifferencesOnTheManifold) {
  const PinholeCamera camera{400, 410, 319.5, 239.5, 640, 480};
  const ReprojectionCost cost(camera, {0.2, -0.3, 1}, {350, 120}, someWhitening());
  const PoseManifold manifold;
  const PoseBlock pose = toBlock(somePose(4));
  const double inverse_depth = 0.7;
  const auto residuals = [&](const Eigen::VectorXd& delta) {
    PoseBlock moved{};
    manifold.Plus(pose.data(), delta.data(), moved.data());
    const double moved_depth = inverse_depth + delta[6];
    const double* parameters[] = {moved.data(), &moved_depth};
    Eigen::VectorXd r(2);
    EXPECT_TRUE(cost.Evaluate(parameters, r.data(), nullptr));
    return r;
  };
  const double* parameters[] = {pose.data(), &inverse_depth};
  Eigen::Vector2d r;
  RowMajor2x7 J_pose;
  Eigen::Vector2d J_inverse_depth;
  double* jacobians[] = {J_pose.data(), J_inverse_depth.data()};
  ASSERT_TRUE(cost.Evaluate(parameters, r.data(), jacobians));
  RowMajor7x6 plus;
  manifold.PlusJacobian(pose.data(), plus.data());
  const Eigen::MatrixXd J = numericJacobian(residuals, 7);
  EXPECT_LT(relativeDifference(J_pose * plus, J.leftCols(6)), 1e-7);
  EXPECT_LT(relativeDifference(J_inverse_depth, J.col(6)), 1e-7);
}

TEST(ReprojectionCost, RefusesPointsBehindTheCamera) {
  const PinholeCamera camera{400, 410, 319.5, 239.5, 640, 480};
  const ReprojectionCost cost(camera, {0, 0, 1}, {350, 120}, someWhitening());
  const PoseBlock pose = toBlock(SE3(Eigen::Matrix3d::Identity(), {0, 0, -1}));
  const double inverse_depth = 2;  // at z = 0.5, the camera has moved to z = 1
  const double* parameters[] = {pose.data(), &inverse_depth};
  Eigen::Vector2d r;
  EXPECT_FALSE(cost.Evaluate(parameters, r.data(), nullptr));
}

TEST(GeometricAdjustment, RecoversTruthFromAPerturbedStart) {
  SyntheticMap scene = makeSyntheticMap({300, 5, 0, 0.3}, 5);
  const GeometricReport report =
      assign(adjustGeometry(scene.start, scene.camera, huber()), scene.start);
  ASSERT_TRUE(report.usable);
  EXPECT_EQ(report.removed_severe + report.removed_normal + report.removed_unseen, 0);
  EXPECT_LT(report.residual_rms, 1e-6);
  for (std::size_t k = 1; k < 5; ++k) {
    EXPECT_THAT(*scene.start.frames[k].T_cam_ref,
                Se3Near(*scene.truth.frames[k].T_cam_ref, 1e-6, 1e-6))
        << k;
  }
  for (std::size_t i = 0; i < scene.truth.corners.size(); ++i) {
    EXPECT_NEAR(scene.start.corners[i].inverse_depth, scene.truth.corners[i].inverse_depth, 1e-6);
  }
}

constexpr Stopping kExact{200, 1e-16};

class BothSolvers : public testing::TestWithParam<RobustLoss> {};

TEST_P(BothSolvers, FindTheSameMinimum) {
  for (std::uint64_t seed = 40; seed < 45; ++seed) {
    SyntheticMap scene = makeSyntheticMap({200, 6, 0.5, 0.2}, seed);
    Random random(seed);
    for (CornerObservation& observation : scene.start.observations) {
      if (random.uniform() < 0.1) {  // beyond the loss's limit
        observation.pixel += Eigen::Vector2d{random.uniform(-30, 30), random.uniform(-30, 30)};
      }
      observation.whitening = someWhitening();
    }
    GeometricOptions options = huber();
    options.loss = GetParam();
    InitialMap by_ceres = scene.start;
    InitialMap by_schur = scene.start;
    ASSERT_TRUE(solveWithCeres(by_ceres, scene.camera, options, kExact));
    ASSERT_TRUE(solveWithSchur(by_schur, scene.camera, options, kExact));
    ASSERT_TRUE(normalizeCornerScale(by_ceres) && normalizeCornerScale(by_schur));
    const double cost = reprojectionCost(by_ceres, scene.camera, options).value_or(0);
    EXPECT_NEAR(reprojectionCost(by_schur, scene.camera, options).value_or(1) / cost, 1, 1e-9);
    for (std::size_t k = 1; k < by_ceres.frames.size(); ++k) {
      EXPECT_THAT(*by_schur.frames[k].T_cam_ref, Se3Near(*by_ceres.frames[k].T_cam_ref, 1e-4, 1e-5))
          << k;
    }
    for (std::size_t i = 0; i < by_ceres.corners.size(); ++i) {
      EXPECT_NEAR(by_schur.corners[i].inverse_depth, by_ceres.corners[i].inverse_depth, 1e-5) << i;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(EveryLoss,
                         BothSolvers,
                         testing::Values(RobustLoss::kHuber, RobustLoss::kCauchy));

TEST(GeometricAdjustment, RemovesPlantedOutliersAndKeepsMapConsistent) {
  SyntheticMap scene = makeSyntheticMap({300, 5, 0.2, 0.1}, 7);
  for (CornerObservation& observation : scene.start.observations) {
    if (observation.corner % 10 == 0 && observation.frame == 3) {
      observation.pixel += Eigen::Vector2d(20, -25);  // 30 severe ones
    }
    if (observation.corner % 10 == 5 && observation.frame == 4) {
      observation.pixel += Eigen::Vector2d(-4, 5);  // 30 normal ones
    }
  }
  const std::vector<Corner> before = scene.start.corners;
  const GeometricReport report =
      assign(adjustGeometry(scene.start, scene.camera, huber()), scene.start);
  ASSERT_TRUE(report.usable);
  EXPECT_GE(report.removed_severe, 30);
  EXPECT_GE(report.removed_normal, 25);
  EXPECT_LE(report.removed_severe + report.removed_normal, 62);
  std::vector<int> seen(scene.start.corners.size(), 0);
  for (const CornerObservation& observation : scene.start.observations) {
    ++seen.at(observation.corner);
  }
  EXPECT_EQ(std::count(seen.begin(), seen.end(), 4), static_cast<long>(seen.size()));
  for (const Corner& corner : scene.start.corners) {
    const auto match = std::find_if(before.begin(), before.end(), [&](const Corner& other) {
      return other.pixel == corner.pixel;
    });
    ASSERT_NE(match, before.end());
    EXPECT_NE((match - before.begin()) % 10, 0);
  }
  EXPECT_THAT(*scene.start.frames[4].T_cam_ref,
              Se3Near(*scene.truth.frames[4].T_cam_ref, 0.1, 0.01));
}

TEST(GeometricAdjustment, RemovesCornersBehindTheCameraAndUnseenOnes) {
  SyntheticMap scene = makeSyntheticMap({200, 4, 0.1, 0.05}, 8);
  scene.start.corners[3].inverse_depth = -0.2;
  scene.start.frames[2].T_cam_ref.reset();
  scene.start.corners.push_back({{100, 100}, 1.0, 0});  // seen in the unposed frame alone
  scene.start.observations.push_back({200, 2, {105, 100}});
  const GeometricReport report =
      assign(adjustGeometry(scene.start, scene.camera, huber()), scene.start);
  ASSERT_TRUE(report.usable);
  EXPECT_EQ(report.removed_unseen, 1);
  EXPECT_EQ(report.removed_severe, 1);
  EXPECT_EQ(scene.start.corners.size(), 199U);
  EXPECT_FALSE(scene.start.frames[2].T_cam_ref.has_value());
  EXPECT_FALSE(scene.start.frames[2].covariance.has_value());
  EXPECT_TRUE(scene.start.frames[1].covariance.has_value());
}

TEST(GeometricAdjustment, FailsWithTooFewCorners) {
  SyntheticMap scene = makeSyntheticMap({49, 4, 0.1, 0.05}, 9);
  EXPECT_FALSE(assign(adjustGeometry(scene.start, scene.camera, huber()), scene.start).usable);
}

TEST(GeometricAdjustment, FailsWithoutParallaxAndStaysSilent) {
  SyntheticMap scene = makeSyntheticMap({100, 4, 0, 0}, 11);
  for (std::size_t k = 1; k < 4; ++k) {
    scene.start.frames[k].T_cam_ref = SE3();
  }
  for (CornerObservation& observation : scene.start.observations) {
    observation.pixel = scene.start.corners[observation.corner].pixel;
  }
  testing::internal::CaptureStderr();
  testing::internal::CaptureStdout();
  EXPECT_FALSE(assign(adjustGeometry(scene.start, scene.camera, huber()), scene.start).usable);
  EXPECT_EQ(testing::internal::GetCapturedStdout(), "");
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
}

TEST(GeometricAdjustment, SameInputGivesSameBits) {
  SyntheticMap a = makeSyntheticMap({200, 4, 0.3, 0.1}, 12);
  SyntheticMap b = makeSyntheticMap({200, 4, 0.3, 0.1}, 12);
  ASSERT_TRUE(assign(adjustGeometry(a.start, a.camera, huber()), a.start).usable);
  ASSERT_TRUE(assign(adjustGeometry(b.start, b.camera, huber()), b.start).usable);
  EXPECT_EQ(a.start.frames[3].T_cam_ref->matrix(), b.start.frames[3].T_cam_ref->matrix());
  for (std::size_t i = 0; i < a.start.corners.size(); ++i) {
    EXPECT_EQ(a.start.corners[i].inverse_depth, b.start.corners[i].inverse_depth);
    EXPECT_EQ(a.start.corners[i].variance, b.start.corners[i].variance);
  }
}

}  // namespace
}  // namespace dsorb::init_orb
