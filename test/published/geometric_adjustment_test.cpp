// SPDX-License-Identifier: BSD-3-Clause
#include "base/median.h"
#include "published/bundle_adjustment.h"
#include "support/jacobian_check.h"
#include "support/matchers.h"
#include "support/synthetic_map.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace dsorb::published {
namespace {

using RowMajor2x7 = Eigen::Matrix<double, 2, 7, Eigen::RowMajor>;

SE3 somePose(std::uint64_t seed) {
  Random random(seed);
  Vector6d xi;
  for (int d = 0; d < 6; ++d) xi[d] = random.uniform(-0.5, 0.5);
  return SE3::exp(xi);
}

Map mapOf(const init_orb::InitialMap& from) {
  Map map;
  map.frames = from.frames;
  for (const auto& corner : from.corners) {
    map.points.push_back({corner.pixel.cast<float>(), corner.inverse_depth});
  }
  map.corners = map.points.size();
  for (const auto& seen : from.observations) {
    map.observations.push_back({seen.corner, seen.frame, seen.pixel});
  }
  return map;
}

/// A synthetic map whose corners lie on pixels that floats hold.
struct Scene {
  Scene(const SyntheticMapOptions& options, std::uint64_t seed)
      : synthetic(makeSyntheticMap(options, seed)),
        truth(mapOf(synthetic.truth)),
        start(mapOf(synthetic.start)),
        camera(synthetic.camera) {}
  SyntheticMap synthetic;
  Map truth;
  Map start;
  PinholeCamera camera;
};

TEST(ReprojectionCost, JacobiansMatchCentralDifferencesByALeftIncrement) {
  const PinholeCamera camera{400, 410, 319.5, 239.5, 640, 480};
  const ReprojectionCost cost(camera, {0.2, -0.3, 1}, {350, 120});
  const PoseBlock pose = toBlock(somePose(4));
  const double inverse_depth = 0.7;
  const auto residuals = [&](const Eigen::VectorXd& delta) {
    const PoseBlock moved = toBlock(SE3::exp(Vector6d(delta.head<6>())) * somePose(4));
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
  const Eigen::MatrixXd J = numericJacobian(residuals, 7);
  EXPECT_LT(relativeDifference(J_pose.leftCols(6), J.leftCols(6)), 1e-7);
  EXPECT_EQ(J_pose.col(6).norm(), 0);
  EXPECT_LT(relativeDifference(J_inverse_depth, J.col(6)), 1e-7);
}

TEST(ReprojectionCost, RefusesPointsBehindTheCamera) {
  const PinholeCamera camera{400, 410, 319.5, 239.5, 640, 480};
  const ReprojectionCost cost(camera, {0, 0, 1}, {350, 120});
  const PoseBlock pose = toBlock(SE3(Eigen::Matrix3d::Identity(), {0, 0, -1}));
  const double inverse_depth = 2;  // at z = 0.5, the camera has moved to z = 1
  const double* parameters[] = {pose.data(), &inverse_depth};
  Eigen::Vector2d r;
  EXPECT_FALSE(cost.Evaluate(parameters, r.data(), nullptr));
}

TEST(GeometricAdjustment, RecoversTruthFromAPerturbedStart) {
  Scene scene({300, 5, 0, 0.3}, 5);
  const GeometricReport report = adjustGeometry(scene.start, scene.camera);
  ASSERT_TRUE(report.usable);
  EXPECT_EQ(report.removed_severe + report.removed_normal, 0);
  EXPECT_LT(report.residual_rms, 1e-4);  // pixels of corners are floats
  for (std::size_t k = 1; k < 5; ++k) {
    EXPECT_THAT(scene.start.pose(k), Se3Near(scene.truth.pose(k), 1e-5, 1e-5)) << k;
  }
  for (std::size_t i = 0; i < scene.truth.points.size(); ++i) {
    EXPECT_NEAR(scene.start.points[i].inverse_depth, scene.truth.points[i].inverse_depth, 1e-5);
  }
}

TEST(GeometricAdjustment, RemovesPlantedOutliersAndKeepsMapConsistent) {
  Scene scene({300, 5, 0.2, 0.1}, 7);
  for (Observation& observation : scene.start.observations) {
    if (observation.corner % 10 == 0 && observation.frame == 3) {
      observation.pixel += Eigen::Vector2d(20, -25);  // 30 severe ones
    }
    if (observation.corner % 10 == 5 && observation.frame == 4) {
      observation.pixel += Eigen::Vector2d(-4, 5);  // 30 normal ones
    }
  }
  const std::vector<MapPoint> before = scene.start.points;
  const GeometricReport report = adjustGeometry(scene.start, scene.camera);
  ASSERT_TRUE(report.usable);
  EXPECT_GE(report.removed_severe, 30);
  EXPECT_GE(report.removed_normal, 25);
  EXPECT_LE(report.removed_severe + report.removed_normal, 62);
  std::vector<int> seen(scene.start.points.size(), 0);
  for (const Observation& observation : scene.start.observations) ++seen.at(observation.corner);
  EXPECT_EQ(std::count(seen.begin(), seen.end(), 4), static_cast<long>(seen.size()));
  for (const MapPoint& corner : scene.start.points) {
    const auto match = std::find_if(before.begin(), before.end(), [&](const MapPoint& other) {
      return other.pixel == corner.pixel;
    });
    ASSERT_NE(match, before.end());
    EXPECT_NE((match - before.begin()) % 10, 0);
  }
  EXPECT_THAT(scene.start.pose(4), Se3Near(scene.truth.pose(4), 0.1, 0.01));
}

TEST(GeometricAdjustment, RemovesCornersBehindTheCamera) {
  Scene scene({200, 4, 0.1, 0.05}, 8);
  scene.start.points[3].inverse_depth = -0.2;
  const GeometricReport report = adjustGeometry(scene.start, scene.camera);
  ASSERT_TRUE(report.usable);
  EXPECT_EQ(report.removed_severe, 1);
  EXPECT_EQ(scene.start.points.size(), 199U);
}

TEST(GeometricAdjustment, FailsWithTooFewCorners) {
  Scene scene({49, 4, 0.1, 0.05}, 9);
  EXPECT_FALSE(adjustGeometry(scene.start, scene.camera).usable);
}

TEST(GeometricAdjustment, FailsWithoutParallaxAndStaysSilent) {
  Scene scene({100, 4, 0, 0}, 11);
  for (std::size_t k = 1; k < 4; ++k) scene.start.frames[k].T_cam_ref = SE3();
  for (Observation& observation : scene.start.observations) {
    observation.pixel = scene.start.points[observation.corner].pixel.cast<double>();
  }
  testing::internal::CaptureStderr();
  testing::internal::CaptureStdout();
  EXPECT_FALSE(adjustGeometry(scene.start, scene.camera).usable);
  EXPECT_EQ(testing::internal::GetCapturedStdout(), "");
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
}

TEST(GeometricAdjustment, VariancesPredictErrorsThatNeighboursShare) {
  std::vector<double> depth_ratios;
  std::vector<double> pose_ratios;
  for (std::uint64_t seed = 40; seed < 70; ++seed) {
    SyntheticMap synthetic = makeSyntheticMap({600, 4, 0.1, 0}, seed);
    addSharedErrors(synthetic, 0.3, seed);
    const Map truth = mapOf(synthetic.truth);
    Map map = mapOf(synthetic.start);
    ASSERT_TRUE(adjustGeometry(map, synthetic.camera).usable);
    for (std::size_t i = 0; i < map.points.size(); ++i) {
      const double error = map.points[i].inverse_depth - truth.points[i].inverse_depth;
      depth_ratios.push_back(error * error / map.points[i].variance);
    }
    const Vector6d error = (truth.pose(3) * map.pose(3).inverse()).log();
    pose_ratios.push_back(error.dot(map.frames[3].covariance->inverse() * error) / 6);
  }
  // Medians expected: 0.455 for chi-square 1, less where errors of a track count once for all
  // frames (measured 0.15); 0.891 for chi-square 6 over 6 (measured 1.17).
  EXPECT_GT(medianOf(depth_ratios), 0.08);
  EXPECT_LT(medianOf(depth_ratios), 0.9);
  EXPECT_NEAR(medianOf(pose_ratios), 0.891, 0.45);
}

}  // namespace
}  // namespace dsorb::published
