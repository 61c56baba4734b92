// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/semi_dense/semi_dense_depth.h"

#include "base/median.h"
#include "base/parallel.h"
#include "init/orb/semi_dense/corner_prior.h"
#include "support/plane_scene.h"

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace dsorb::init_orb {
namespace {

TEST(CandidateDepth, MultipliesGaussians) {
  CandidateDepth depth({{0, 0}, 1.0F, 0.04F}, DepthFusion::kProduct);
  depth.add({{0, 0}, 1.3F, 0.01F});
  EXPECT_FLOAT_EQ(depth.current().inverse_depth, (1.0F * 0.01F + 1.3F * 0.04F) / 0.05F);
  EXPECT_FLOAT_EQ(depth.current().variance, 0.04F * 0.01F / 0.05F);
  EXPECT_EQ(depth.observations(), 1);
}

TEST(CandidateDepth, KeepsTheMostPreciseObservationAndNeverThePrior) {
  CandidateDepth depth({{0, 0}, 1.0F, 0.01F}, DepthFusion::kMostPrecise);
  depth.add({{0, 0}, 1.1F, 0.02F});
  EXPECT_FLOAT_EQ(depth.current().inverse_depth, 1.1F);
  depth.add({{0, 0}, 1.2F, 0.05F});
  EXPECT_FLOAT_EQ(depth.current().inverse_depth, 1.1F);
  depth.add({{0, 0}, 1.15F, 0.001F});
  EXPECT_FLOAT_EQ(depth.current().inverse_depth, 1.15F);
  EXPECT_EQ(depth.observations(), 3);
}

TEST(CandidateDepth, ThreeObservationsOutsideTheGateRemoveThePoint) {
  CandidateDepth depth({{0, 0}, 1.0F, 0.01F}, DepthFusion::kMostPrecise);
  depth.add({{0, 0}, 1.5F, 0.01F});  // 3.5 combined sigma
  depth.add({{0, 0}, 1.4F, 0.01F});  // 2.8: inside, becomes the estimate
  EXPECT_EQ(depth.observations(), 1);
  depth.add({{0, 0}, 0.9F, 0.01F});
  EXPECT_FALSE(depth.removed());
  depth.add({{0, 0}, 0.9F, 0.01F});
  EXPECT_TRUE(depth.removed());
}

TEST(CornerPrior, WeighsTheNearestCornersAsASearchOverAllOfThem) {
  Random random(2);
  std::vector<Corner> corners;
  for (int i = 0; i < 1200; ++i) {
    corners.push_back(
        {{random.uniform(0, 639), random.uniform(0, 479)}, random.uniform(0.5, 1.5), 0.001});
  }
  const CornerPrior prior(corners, 640, 480);
  int above_floor = 0;
  for (int trial = 0; trial < 50; ++trial) {
    const Eigen::Vector2d at{random.uniform(0, 639), random.uniform(0, 479)};
    std::sort(corners.begin(), corners.end(), [&](const Corner& a, const Corner& b) {
      return (a.pixel - at).norm() < (b.pixel - at).norm();
    });
    double weights = 0;
    double mean = 0;
    double variance = 0;
    for (int i = 0; i < 5; ++i) {
      const Corner& corner = corners[static_cast<std::size_t>(i)];
      const double weight = 1 / (1 + (corner.pixel - at).norm());
      weights += weight;
      mean += weight * corner.inverse_depth;
    }
    mean /= weights;
    for (int i = 0; i < 5; ++i) {
      const Corner& corner = corners[static_cast<std::size_t>(i)];
      const double weight = 1 / (1 + (corner.pixel - at).norm());
      variance += weight / weights * (std::pow(corner.inverse_depth - mean, 2) + corner.variance);
    }
    const SemiDensePoint estimate = prior.at(at.cast<float>());
    EXPECT_NEAR(estimate.inverse_depth, mean, 1e-5);
    const double floor = static_cast<double>(kMinPriorSigma) * mean;
    EXPECT_NEAR(estimate.variance, std::max(variance, floor * floor), 1e-5);
    above_floor += variance > floor * floor ? 1 : 0;
  }
  EXPECT_GT(above_floor, 40);
}

TEST(CornerPrior, LooksAsFarInAnImageOfAnySize) {
  const std::vector<Corner> corners = {{{10, 10}, 0.4, 0}, {{20, 10}, 1.0, 0}, {{10, 30}, 2.0, 0}};
  const auto is_close = [&](int width, int height) {
    const float wide = CornerPrior(corners, width, height).at({300, 200}).variance;
    return CornerPrior(corners, width, height).at({60, 10}).variance < wide;
  };
  EXPECT_TRUE(is_close(640, 480));
  EXPECT_FALSE(is_close(320, 240));
}

TEST(CornerPrior, CoversTheWidenedRangeOfAllCornersWhereNoneIsClose) {
  const std::vector<Corner> corners = {{{10, 10}, 0.4, 0}, {{20, 10}, 1.0, 0}, {{10, 30}, 2.0, 0}};
  const SemiDensePoint wide = CornerPrior(corners, 320, 240).at({300, 200});
  const float reach = kSearchSigmas * std::sqrt(wide.variance);
  EXPECT_NEAR(wide.inverse_depth - reach, 0.2F, 1e-5F);
  EXPECT_NEAR(wide.inverse_depth + reach, 4.0F, 1e-5F);
}

/// A reference, later frames and corners with exact inverse depths.
InitialMap makeMap(const PlaneScene& scene, const std::vector<SE3>& poses, double noise) {
  InitialMap map;
  map.frames.push_back({scene.render(SE3(), noise, 0), SE3(), {}, {}});
  for (const SE3& T : poses) {
    const auto index = static_cast<int>(map.frames.size());
    map.frames.push_back({scene.render(T, noise, index), T, {}, {}});
  }
  for (int y = 20; y < 240; y += 40) {
    for (int x = 20; x < 320; x += 40) {
      map.corners.push_back({{x, y}, scene.inverseDepth({x, y}), 1e-4});
    }
  }
  return map;
}

std::vector<SE3> sideways() {
  return {poseOf(0.03, 0.01, 0.02, 0.01),
          poseOf(0.06, 0.02, 0.04, 0.02),
          poseOf(0.1, 0.03, 0.06, 0.03)};
}

std::vector<double> relativeErrors(const InitialMap& map, const PlaneScene& scene) {
  std::vector<double> errors;
  for (const SemiDensePoint& point : map.points) {
    const double truth = scene.inverseDepth(point.pixel.cast<double>());
    errors.push_back(std::abs(point.inverse_depth / truth - 1));
  }
  return errors;
}

TEST(SemiDenseDepth, FindsTheDepthOfAPlane) {
  const PlaneScene scene(3);
  InitialMap map = makeMap(scene, sideways(), 0);
  const SemiDenseReport report = estimateSemiDenseDepth(map, scene.camera(), {}, 1);
  EXPECT_EQ(report.points, static_cast<int>(map.points.size()));
  EXPECT_GT(report.points, report.candidates / 3);
  EXPECT_LT(medianOf(relativeErrors(map, scene)), 0.0012);  // measured 0.0006, margin x2
}

TEST(SemiDenseDepth, EstimatesAndUndoesBrightnessChanges) {
  const PlaneScene scene(9);
  InitialMap map = makeMap(scene, sideways(), 0);
  map.frames[3].frame = scene.render(*map.frames[3].T_cam_ref, 0, 3, {1.3, -20});
  for (std::size_t i = 0; i < map.corners.size(); ++i) {
    const Corner& corner = map.corners[i];
    for (std::size_t k = 1; k < 4; ++k) {
      const Eigen::Vector3d point = scene.camera().unproject(corner.pixel) / corner.inverse_depth;
      const SE3& T = *map.frames[k].T_cam_ref;
      map.observations.push_back({i, k, scene.camera().project(T * point)});
    }
  }
  map.observations[5].pixel += Eigen::Vector2d(15, 10);  // one bad track
  estimateSemiDenseDepth(map, scene.camera(), {}, 1);
  EXPECT_NEAR(map.frames[1].affine.a, 0, 0.01);
  EXPECT_NEAR(map.frames[3].affine.a, std::log(1.3), 0.01);
  EXPECT_NEAR(map.frames[3].affine.b, -20, 1.5);
  EXPECT_GT(map.points.size(), 200U);
  EXPECT_LT(medianOf(relativeErrors(map, scene)), 0.005);
}

TEST(SemiDenseDepth, VariancesPredictErrorsOfNoisyImagesAndPoses) {
  const PlaneScene scene(4);
  // Poses off by 0.5 mrad and 0.1 % of the mean depth, known to be so.
  Vector6d sigma;
  sigma << 1e-3, 1e-3, 1e-3, 5e-4, 5e-4, 5e-4;
  for (const DepthFusion fusion : {DepthFusion::kProduct, DepthFusion::kMostPrecise}) {
    std::vector<double> ratios;
    for (std::uint64_t trial = 0; trial < 2; ++trial) {
      Random random(trial);
      InitialMap map = makeMap(scene, sideways(), 2);
      for (std::size_t k = 1; k < map.frames.size(); ++k) {
        Vector6d xi;
        for (int d = 0; d < 6; ++d) xi[d] = sigma[d] * random.gaussian();
        map.frames[k].T_cam_ref = SE3::exp(xi) * *map.frames[k].T_cam_ref;
        map.frames[k].covariance = Matrix6d(sigma.cwiseAbs2().asDiagonal());
      }
      SemiDenseOptions options;
      options.fusion = fusion;
      estimateSemiDenseDepth(map, scene.camera(), options, 1);
      for (const SemiDensePoint& point : map.points) {
        const double error = point.inverse_depth - scene.inverseDepth(point.pixel.cast<double>());
        ratios.push_back(error * error / point.variance);
      }
    }
    // Measured 0.22 to 0.40: the floor of the line's error is above the truth of this scene.
    EXPECT_GT(medianOf(ratios), 0.15);
    EXPECT_LT(medianOf(ratios), 2.0);
  }
}

TEST(SemiDenseDepth, IsBitIdenticalForAnyNumberOfThreads) {
  const PlaneScene scene(6, 2);  // the random choice takes part
  InitialMap one = makeMap(scene, sideways(), 2);
  InitialMap two = one;
  const SemiDenseOptions options;
  TaskArena(1).run([&] { return estimateSemiDenseDepth(one, scene.camera(), options, 7); });
  TaskArena(2).run([&] { return estimateSemiDenseDepth(two, scene.camera(), options, 7); });
  ASSERT_EQ(one.points.size(), two.points.size());
  ASSERT_GT(one.points.size(), 100U);
  for (std::size_t i = 0; i < one.points.size(); ++i) {
    EXPECT_EQ(one.points[i].pixel, two.points[i].pixel);
    EXPECT_EQ(one.points[i].inverse_depth, two.points[i].inverse_depth);
    EXPECT_EQ(one.points[i].variance, two.points[i].variance);
  }
}

TEST(SemiDenseDepth, TakesNoMoreCandidatesThanWanted) {
  const PlaneScene scene(7, 3);
  InitialMap map = makeMap(scene, sideways(), 0);
  const SemiDenseReport report = estimateSemiDenseDepth(map, scene.camera(), SemiDenseOptions(), 1);
  EXPECT_EQ(report.candidates, 3000);
}

TEST(SemiDenseDepth, FindsNothingWithoutPosedFrames) {
  const PlaneScene scene(8);
  InitialMap map = makeMap(scene, {}, 0);
  EXPECT_EQ(estimateSemiDenseDepth(map, scene.camera(), SemiDenseOptions(), 1).points, 0);
}

TEST(SemiDenseDepth, KeepsTheMostCertainPoints) {
  InitialMap map;
  map.corners.resize(2);
  for (int i = 0; i < 5; ++i) {
    SemiDensePoint point;
    point.pixel = {static_cast<float>(i), 0};
    point.inverse_depth = i == 3 ? 10.0F : 1.0F;
    point.variance = i == 3 ? 20.0F : static_cast<float>(5 - i);  // relative: 5 4 3 .2 1
    map.points.push_back(point);
  }
  keepBestPoints(map, 7);
  EXPECT_EQ(map.points.size(), 5U);
  keepBestPoints(map, 5);
  ASSERT_EQ(map.points.size(), 3U);
  EXPECT_EQ(map.points[0].pixel.x(), 2);
  EXPECT_EQ(map.points[1].pixel.x(), 3);
  EXPECT_EQ(map.points[2].pixel.x(), 4);
  keepBestPoints(map, 1);
  EXPECT_TRUE(map.points.empty()) << "corners alone are more";
}

}  // namespace
}  // namespace dsorb::init_orb
