// SPDX-License-Identifier: BSD-3-Clause
#include "image/cell_grid.h"

#include "base/random.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstddef>
#include <vector>

namespace dsorb {
namespace {

TEST(CellGrid, CoversTheImageAndTakesPositionsOutsideIntoItsBorder) {
  const CellGrid cells(640, 470, 64);
  EXPECT_EQ(cells.columns(), 10);
  EXPECT_EQ(cells.rows(), 8);
  EXPECT_EQ(cells.size(), 80U);
  EXPECT_EQ(cells.at(639.5, 469.5), 79U);
  EXPECT_EQ(cells.at(64, 63.9), 1U);
  EXPECT_EQ(cells.at(-5, -5), 0U);
  EXPECT_EQ(cells.at(1e4, 0), 9U);
}

TEST(CellQuota, LetsACellTakeTwiceItsEvenShare) {
  CellQuota quota(CellGrid(100, 100, 50), 10);  // four cells: 2.5 each
  for (int i = 0; i < 5; ++i) EXPECT_TRUE(quota.take(10, 10)) << i;
  EXPECT_FALSE(quota.take(10, 10));
  EXPECT_TRUE(quota.take(90, 10));
}

TEST(SpacedPlaces, KeepTheirDistanceAcrossCells) {
  SpacedPlaces places(100, 100, 8);
  EXPECT_TRUE(places.take({15.5F, 15.5F}));
  EXPECT_FALSE(places.take({20, 20}));  // 6.4 px
  EXPECT_TRUE(places.take({23.5F, 15.5F}));
  places.add({20, 21});
  EXPECT_FALSE(places.take({20, 28.9F}));
  EXPECT_TRUE(places.take({20, 29}));
  EXPECT_TRUE(places.take({99, 99}));
}

TEST(PointGrid, FindsTheNearestPointsThatCount) {
  constexpr std::size_t kWanted = 5;
  constexpr float kRadius = 60;
  Random random(1);
  std::vector<Eigen::Vector2f> points;
  for (int i = 0; i < 400; ++i) {
    points.emplace_back(random.uniform(0, 320), random.uniform(0, 240));
  }
  const PointGrid grid(points, CellGrid(320, 240, 20));
  const auto accept = [](std::size_t point) { return point % 3 != 0; };
  for (int i = 0; i < 200; ++i) {
    const Eigen::Vector2f pixel(random.uniform(-10, 330), random.uniform(-10, 250));
    std::vector<float> expected;
    for (std::size_t p = 0; p < points.size(); ++p) {
      const float squared = (points[p] - pixel).squaredNorm();
      if (accept(p) && squared <= kRadius * kRadius) expected.push_back(squared);
    }
    std::sort(expected.begin(), expected.end());
    expected.resize(std::min(expected.size(), kWanted));
    const auto found = grid.nearest<kWanted>(pixel, kRadius, accept);
    ASSERT_EQ(found.count, expected.size()) << i;
    std::size_t place = 0;
    for (const auto& [squared, point] : found) {
      EXPECT_EQ(squared, expected[place++]) << i;
      EXPECT_EQ(squared, (points[point] - pixel).squaredNorm()) << i;
      EXPECT_TRUE(accept(point)) << i;
    }
  }
}

}  // namespace
}  // namespace dsorb
