// SPDX-License-Identifier: BSD-3-Clause
#include "published/structure.h"

#include "base/median.h"
#include "base/parallel.h"
#include "support/plane_scene.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace dsorb::published {
namespace {

/// A reference, later frames sideways and corners with exact inverse depths.
Map makeMap(const PlaneScene& scene, double noise) {
  Map map;
  map.frames.push_back({scene.render(SE3(), noise, 0), SE3(), {}, {}});
  for (int k = 1; k < 4; ++k) {
    const SE3 T = poseOf(0.05 * k, 0.01 * k, 0.02 * k, 0.01 * k);
    map.frames.push_back({scene.render(T, noise, k), T, {}, Matrix6d(1e-8 * Matrix6d::Identity())});
  }
  for (int y = 20; y < 240; y += 40) {
    for (int x = 20; x < 320; x += 40) {
      map.points.push_back(
          {{static_cast<float>(x), static_cast<float>(y)}, scene.inverseDepth({x, y}), 1e-4});
    }
  }
  map.corners = map.points.size();
  return map;
}

TEST(PopulateStructure3D, FindsThePlaneWithVariancesThatPredictTheErrors) {
  const PlaneScene scene(4);
  Map map = makeMap(scene, 2);
  populateStructure3D(map, scene.camera(), 1);
  EXPECT_LE(map.points.size() - map.corners, 3000U);
  ASSERT_GT(map.points.size(), 200U);
  std::vector<double> errors;
  std::vector<double> ratios;
  for (std::size_t i = map.corners; i < map.points.size(); ++i) {
    const MapPoint& point = map.points[i];
    const double truth = scene.inverseDepth(point.pixel.cast<double>());
    errors.push_back(std::abs(point.inverse_depth / truth - 1));
    ratios.push_back(std::pow(point.inverse_depth - truth, 2) / point.variance);
  }
  EXPECT_LT(medianOf(errors), 0.02);
  EXPECT_LT(medianOf(ratios), 2.0);
}

TEST(PopulateStructure3D, IsBitIdenticalForAnyNumberOfThreads) {
  const PlaneScene scene(6, 2);  // the random choice takes part
  Map one = makeMap(scene, 2);
  Map two = one;
  TaskArena(1).run([&] { populateStructure3D(one, scene.camera(), 7); });
  TaskArena(2).run([&] { populateStructure3D(two, scene.camera(), 7); });
  ASSERT_EQ(one.points.size(), two.points.size());
  ASSERT_GT(one.points.size(), 100U);
  for (std::size_t i = 0; i < one.points.size(); ++i) {
    EXPECT_EQ(one.points[i].pixel, two.points[i].pixel);
    EXPECT_EQ(one.points[i].inverse_depth, two.points[i].inverse_depth);
    EXPECT_EQ(one.points[i].variance, two.points[i].variance);
  }
}

}  // namespace
}  // namespace dsorb::published
