// SPDX-License-Identifier: BSD-3-Clause
#include "base/random.h"
#include "init/coarse/coarse_alignment.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <vector>

namespace dsorb::init_coarse {
namespace {

/// A flat level: makes points without caring for intensities.
class FlatLevel {
 public:
  FlatLevel(int width, int height)
      : intensities_(static_cast<std::size_t>(width * height), 100.0F),
        level_(intensities_.data(), width, height) {}
  [[nodiscard]] PointLevel points(const std::vector<SelectedPixel>& pixels) const {
    return makePointLevel(level_, pixels);
  }
  std::vector<float> intensities_;
  PyramidLevel level_;
};

/// Distinct random pixels inside the border.
std::vector<SelectedPixel> randomPixels(int width, int height, int count, std::uint64_t seed) {
  std::vector<SelectedPixel> all;
  for (int y = 3; y < height - 4; ++y) {
    for (int x = 3; x < width - 4; ++x) all.push_back({x, y, 1});
  }
  Random random(seed);
  for (int i = 0; i < count; ++i) {
    const auto left = static_cast<std::uint32_t>(all.size() - static_cast<std::size_t>(i));
    std::swap(all[static_cast<std::size_t>(i)],
              all[static_cast<std::size_t>(i) + random.below(left)]);
  }
  all.resize(static_cast<std::size_t>(count));
  return all;
}

float squaredDistance(const PointLevel& level, std::size_t a, std::size_t b) {
  const float dx = level.x[a] - level.x[b];
  const float dy = level.y[a] - level.y[b];
  return dx * dx + dy * dy;
}

TEST(CoarsePoints, WantedCountsOfAVgaImage) {
  const int expected[] = {9216, 15360, 46080, 153600, 307200};
  for (int l = 0; l < 5; ++l) EXPECT_EQ(wantedPoints(l, 640, 480), expected[l]);
  EXPECT_EQ(wantedPoints(0, 4, 4), 1) << "never none";
}

TEST(CoarsePoints, SpreadOfNeighboursIsWhatSmoothingLevelled) {
  PointLevel level = FlatLevel(200, 120).points(randomPixels(200, 120, 300, 1));
  EXPECT_EQ(neighbourSpread(level, 7), 0);
  for (std::size_t i = 0; i < level.x.size(); ++i) {
    level.inverse_depth[i] = i % 2 == 0 ? 1.0F : 2.0F;
    level.smoothed[i] = 1.5F;
  }
  for (const std::size_t i : {0U, 7U, 299U}) {
    EXPECT_NEAR(neighbourSpread(level, i), 1.4826 * 0.5, 1e-5);
  }
  std::fill(level.good.begin(), level.good.end(), std::uint8_t{0});
  EXPECT_EQ(neighbourSpread(level, 7), 0) << "nobody to ask";
}

TEST(CoarsePoints, NeighboursAreTheNearestOfAllByBruteForce) {
  const FlatLevel image(200, 120);
  for (const int count : {11, 60, 700, 5000}) {
    const PointLevel level =
        image.points(randomPixels(200, 120, count, static_cast<std::uint64_t>(count)));
    ASSERT_EQ(level.size(), count);
    for (std::size_t i = 0; i < level.x.size(); ++i) {
      std::vector<std::pair<float, std::int32_t>> all;
      for (std::size_t j = 0; j < level.x.size(); ++j) {
        all.emplace_back(squaredDistance(level, i, j), static_cast<std::int32_t>(j));
      }
      std::partial_sort(all.begin(), all.begin() + kNeighbours, all.end());
      ASSERT_EQ(level.neighbours[i * kNeighbours], static_cast<std::int32_t>(i));
      for (std::size_t n = 0; n < kNeighbours; ++n) {
        ASSERT_EQ(level.neighbours[i * kNeighbours + n], all[n].second) << i << " of " << count;
      }
    }
  }
}

TEST(CoarsePoints, FewerPointsThanNeighboursAreMarked) {
  const FlatLevel image(40, 40);
  PointLevel level = image.points({{10, 10, 1}, {20, 10, 1}, {30, 30, 1}});
  ASSERT_EQ(level.size(), 3);
  EXPECT_EQ(level.neighbours[0], 0);
  EXPECT_EQ(level.neighbours[1], 1);
  EXPECT_EQ(level.neighbours[2], 2);
  for (std::size_t n = 3; n < kNeighbours; ++n) EXPECT_EQ(level.neighbours[n], -1);
  smooth(level);
  EXPECT_FLOAT_EQ(level.smoothed[0], 1);
  EXPECT_EQ(image.points({}).size(), 0);
}

TEST(CoarsePoints, PixelsNearTheBorderAndInvalidOnesAreLeftOut) {
  FlatLevel image(40, 30);
  image.intensities_[15 * 40 + 20] = NAN;
  const PointLevel level = image.points(
      {{2, 10, 1}, {3, 10, 1}, {35, 10, 1}, {36, 10, 1}, {10, 26, 1}, {20, 16, 1}, {30, 20, 1}});
  EXPECT_THAT(level.x, testing::ElementsAre(3.1F, 35.1F, 30.1F));
}

TEST(CoarsePoints, ParentIsTheNearestCoarsePointAndNotTooFar) {
  const FlatLevel fine_image(80, 80);
  const FlatLevel coarse_image(40, 40);
  const PointLevel coarse = coarse_image.points({{10, 10, 1}, {12, 10, 1}, {30, 30, 1}});
  PointLevel fine = fine_image.points({{21, 21, 1}, {26, 21, 1}, {40, 40, 1}});
  findParents(coarse, 0, fine);
  EXPECT_THAT(fine.parent, testing::ElementsAre(0, 1, 1));
  findParents(coarse, 2, fine);
  EXPECT_THAT(fine.parent, testing::ElementsAre(0, 1, -1));
}

TEST(CoarsePoints, SmoothingMixesTheNeighboursMedianInIndexOrder) {
  const FlatLevel image(40, 40);
  PointLevel level = image.points({{10, 10, 1}, {12, 10, 1}, {14, 10, 1}, {16, 10, 1}});
  level.smoothed = {1, 2, 3, 4};
  level.inverse_depth = {1, 2, 3, 10};
  level.good = {1, 1, 1, 0};
  smooth(level);
  // Good values 1, 2, 3: median 2; then 1.8, 2, 3; then 1.8, 2, 3.
  EXPECT_THAT(level.smoothed,
              testing::ElementsAre(testing::FloatEq(0.2F * 1 + 0.8F * 2),
                                   testing::FloatEq(0.2F * 2 + 0.8F * 2),
                                   testing::FloatEq(0.2F * 3 + 0.8F * 2),
                                   4.0F));
}

TEST(CoarsePoints, PropagationDownWeighsByCurvature) {
  const FlatLevel image(40, 40);
  PointLevel coarse = image.points({{10, 10, 1}, {20, 20, 1}, {30, 30, 1}});
  PointLevel fine = image.points({{5, 5, 1}, {10, 5, 1}, {15, 5, 1}, {20, 5, 1}, {25, 5, 1}});
  coarse.smoothed = {2, 3, 4};
  coarse.curvature = {4, 0.05F, 4};  // the second is too flat
  coarse.good = {1, 1, 0};
  fine.parent = {0, 0, 1, 2, -1};
  fine.good = {1, 0, 1, 1, 1};
  fine.curvature = {1, 7, 1, 1, 1};
  fine.smoothed = {1, 1, 1, 1, 1};
  propagateDown(coarse, fine);
  // (2 * 1 * 1 + 4 * 2) / (2 * 1 + 4)
  EXPECT_THAT(fine.smoothed, testing::ElementsAre(testing::FloatEq(10.0F / 6), 2, 1, 1, 1));
  EXPECT_THAT(fine.good, testing::ElementsAre(1, 1, 1, 1, 1));
  EXPECT_FLOAT_EQ(fine.curvature[1], 0);
  EXPECT_FLOAT_EQ(fine.trial_inverse_depth[1], 2);
}

TEST(CoarsePoints, PropagationUpAveragesAndKeepsOrphansOnRequest) {
  const FlatLevel image(40, 40);
  PointLevel fine = image.points({{5, 5, 1}, {10, 5, 1}, {15, 5, 1}});
  fine.smoothed = {1, 4, 9};
  fine.curvature = {1, 2, 5};
  fine.good = {1, 1, 0};
  fine.parent = {0, 0, 1};
  for (const bool keep : {true, false}) {
    PointLevel coarse = image.points({{10, 10, 1}, {20, 20, 1}});
    coarse.smoothed = {7, 7};
    coarse.good = {0, 1};
    propagateUp(fine, keep, coarse);
    EXPECT_THAT(coarse.smoothed, testing::ElementsAre(testing::FloatEq(3), keep ? 7 : 0));
    EXPECT_THAT(coarse.good, testing::ElementsAre(1, 1));
    EXPECT_FLOAT_EQ(coarse.inverse_depth[0], 3);
  }
}

TEST(CoarsePoints, BadPointsReviveAtTheMeanOfGoodNeighbours) {
  const FlatLevel image(40, 40);
  PointLevel level = image.points({{10, 10, 1}, {12, 10, 1}, {14, 10, 1}});
  level.smoothed = {1, 2, 4};
  level.good = {0, 1, 1};
  reviveFromNeighbours(level);
  EXPECT_EQ(level.good[0], 1);
  EXPECT_FLOAT_EQ(level.smoothed[0], 3);
  EXPECT_FLOAT_EQ(level.inverse_depth[0], 3);
}

}  // namespace
}  // namespace dsorb::init_coarse
