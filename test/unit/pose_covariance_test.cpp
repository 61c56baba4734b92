// SPDX-License-Identifier: BSD-3-Clause
#include "base/median.h"
#include "estimate/pose_from_points.h"
#include "init/orb/bundle/map_assembly.h"
#include "support/assign_map.h"
#include "support/formal_covariance.h"
#include "support/synthetic_map.h"

#include <Eigen/LU>
#include <gtest/gtest.h>

#include <vector>

namespace dsorb::init_orb {
namespace {

constexpr int kPosedFrames = 9;

/// Every second frame is adjusted, the newest too; the others are posed from the corners.
bool isAdjusted(int frame) {
  return frame > 0 && frame % 2 == 0;
}

/// Medians over maps and frames of the squared error of the pose over its covariance, a sixth.
struct Ratios {
  double adjusted = 0;
  double between = 0;  ///< errors of the depths are not predicted there
};

Ratios measure(const SyntheticMapOptions& kind, double shared, bool formal) {
  std::vector<double> adjusted;
  std::vector<double> between;
  for (std::uint64_t seed = 100; seed < 130; ++seed) {
    SyntheticMap scene = makeSyntheticMap(kind, seed);
    addSharedErrors(scene, shared, seed);
    InitialMap& map = scene.start;
    for (int k = 1; k < kPosedFrames; ++k) {
      if (!isAdjusted(k)) map.frames[static_cast<std::size_t>(k)].T_cam_ref.reset();
    }
    EXPECT_TRUE(adjust(map, scene.camera, huber()));
    if (formal) setFormalCovariances(map, scene.camera, huber());
    EXPECT_EQ(map.corners.size(), scene.truth.corners.size());  // else the gauge is another
    poseOtherFrames(map, scene.camera);
    for (int k = 1; k < kPosedFrames; ++k) {
      const auto at = static_cast<std::size_t>(k);
      const SE3& T = *map.frames[at].T_cam_ref;
      const Vector6d error = (*scene.truth.frames[at].T_cam_ref * T.inverse()).log();
      const auto ratio = [&](const Matrix6d& covariance) {
        return error.dot(covariance.inverse() * error) / 6;
      };
      if (isAdjusted(k)) {
        adjusted.push_back(ratio(*map.frames[at].covariance));
        continue;
      }
      const auto own = poseCovariance(
          observationsByFrame(map, scene.camera)[at], scene.camera, T, {1, formal ? 0.0 : 1.0});
      EXPECT_TRUE(own);
      between.push_back(ratio(*own));
    }
  }
  return {medianOf(adjusted), medianOf(between)};
}

TEST(PoseCovariance, PredictsTheSpreadOfPosesFromNoisyObservations) {
  const Ratios ratios = measure({200, kPosedFrames, 0.3, 0.02}, 0, true);
  // Expected 0.891, chi-square 6 over 6. Measured 0.893 and, without errors of depths, 1.01.
  EXPECT_NEAR(ratios.adjusted, 0.891, 0.15);
  EXPECT_NEAR(ratios.between, 1.01, 0.2);
}

TEST(PoseCovariance, ClusteredPredictsErrorsThatNeighboursShare) {
  const Ratios ratios = measure({600, kPosedFrames, 0.1, 0.02}, 0.3, false);
  // Measured 0.833 and 1.31; formal covariances: 6.9.
  EXPECT_NEAR(ratios.adjusted, 0.891, 0.2);
  EXPECT_NEAR(ratios.between, 1.31, 0.2);
  EXPECT_GT(measure({600, kPosedFrames, 0.1, 0.02}, 0.3, true).between, 4);
}

TEST(PoseCovariance, HoldsTheStepThatTheObservationsStillAskFor) {
  const SyntheticMap scene = makeSyntheticMap({100, kPosedFrames, 0, 0}, 5);
  const std::vector<PointObservation> observations =
      observationsByFrame(scene.truth, scene.camera)[4];
  Vector6d step;
  step << 1e-3, -2e-3, 1e-3, 5e-4, 1e-3, -1e-3;
  const SE3 displaced = SE3::exp(step) * *scene.truth.frames[4].T_cam_ref;
  const auto covariance = poseCovariance(observations, scene.camera, displaced, {1, 0});
  ASSERT_TRUE(covariance);
  const Vector6d along = step.normalized();
  // Measured 1.023: the errors that the step leaves behind are taken for noise, too.
  EXPECT_NEAR(along.dot(*covariance * along) / step.squaredNorm(), 1.0, 0.05);
}

TEST(PoseCovariance, SaysNothingWhereThePoseWouldNotBeTaken) {
  const SyntheticMap scene = makeSyntheticMap({100, kPosedFrames, 0, 0}, 6);
  std::vector<PointObservation> observations = observationsByFrame(scene.truth, scene.camera)[4];
  const SE3& T = *scene.truth.frames[4].T_cam_ref;
  EXPECT_TRUE(poseCovariance(observations, scene.camera, T, {1, 4}));
  std::vector<PointObservation> wrong = observations;
  for (std::size_t i = 0; i < 60; ++i) wrong[i].pixel.x() += 50;
  EXPECT_FALSE(poseCovariance(wrong, scene.camera, T, {1, 4}));
  observations.resize(9);
  EXPECT_FALSE(poseCovariance(observations, scene.camera, T, {1, 4}));
}

}  // namespace
}  // namespace dsorb::init_orb
