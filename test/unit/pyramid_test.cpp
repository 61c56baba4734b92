// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/image/pyramid.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <stdexcept>
#include <vector>

namespace dsorb {
namespace {

TEST(PyramidTest, LevelCountFollowsTheSize) {
  EXPECT_EQ(pyramidLevels(640, 480), 4);
  EXPECT_EQ(pyramidLevels(752, 480), 5);
  EXPECT_EQ(pyramidLevels(424, 320), 4);
  EXPECT_EQ(pyramidLevels(1280, 1024), 5);  // limited
  EXPECT_EQ(pyramidLevels(641, 480), 1);
}

TEST(PyramidTest, LinearRampKeepsValueAndGradient) {
  std::vector<float> large;
  for (int y = 0; y < 96; ++y) {
    for (int x = 0; x < 128; ++x) {
      large.push_back(3.0F + 1.5F * static_cast<float>(x) - 0.5F * static_cast<float>(y));
    }
  }
  const Pyramid pyramid(ImageView(large.data(), 128, 96));
  ASSERT_EQ(pyramid.levels(), 2);
  EXPECT_FLOAT_EQ(pyramid.level(0).at(10, 20).intensity, 3.0F + 15.0F - 10.0F);
  EXPECT_FLOAT_EQ(pyramid.level(0).at(10, 20).dx, 1.5F);
  EXPECT_FLOAT_EQ(pyramid.level(0).at(10, 20).dy, -0.5F);
  // Level-1 pixel (5, 10) lies at (10.5, 20.5) of level 0; its pixels are twice as large.
  EXPECT_FLOAT_EQ(pyramid.level(1).at(5, 10).intensity, 3.0F + 1.5F * 10.5F - 0.5F * 20.5F);
  EXPECT_FLOAT_EQ(pyramid.level(1).at(5, 10).dx, 3.0F);
  EXPECT_FLOAT_EQ(pyramid.level(1).at(5, 10).dy, -1.0F);
}

TEST(PyramidTest, OuterPixelsHaveNoGradient) {
  std::vector<std::uint8_t> image(64 * 48);
  for (std::size_t i = 0; i < image.size(); ++i) image[i] = static_cast<std::uint8_t>(i * 7);
  const Pyramid pyramid(ImageView(image.data(), 64, 48));
  const PyramidLevel& level = pyramid.level(0);
  for (int x = 0; x < 64; ++x) {
    EXPECT_EQ(level.at(x, 0).dx, 0);
    EXPECT_EQ(level.at(x, 47).dy, 0);
  }
  for (int y = 0; y < 48; ++y) {
    EXPECT_EQ(level.at(0, y).dx, 0);
    EXPECT_EQ(level.at(63, y).dy, 0);
  }
}

TEST(PyramidTest, InvalidPixelsSpreadToCoarserLevelsAndHaveNoGradient) {
  std::vector<float> image(128 * 96, 100.0F);
  image[20 * 128 + 10] = std::numeric_limits<float>::quiet_NaN();
  const Pyramid pyramid(ImageView(image.data(), 128, 96));
  EXPECT_TRUE(std::isnan(pyramid.level(0).at(10, 20).intensity));
  EXPECT_TRUE(std::isnan(pyramid.level(1).at(5, 10).intensity));
  for (int y = 19; y <= 21; ++y) {
    for (int x = 9; x <= 11; ++x) {
      EXPECT_EQ(pyramid.level(0).at(x, y).dx, 0);
      EXPECT_EQ(pyramid.level(0).at(x, y).dy, 0);
    }
  }
}

TEST(PyramidTest, RefusesImagesThatAreEmptyOrTiny) {
  const std::vector<std::uint8_t> image(100);
  EXPECT_THROW(Pyramid{ImageView{}}, std::invalid_argument);
  EXPECT_THROW(Pyramid(ImageView(image.data(), 10, 10)), std::invalid_argument);
}

TEST(ImageViewTest, RefusesRowsThatOverlapOrSplitAPixel) {
  const std::vector<float> image(64);
  EXPECT_NO_THROW(ImageView(image.data(), 6, 8, 32));
  EXPECT_THROW(ImageView(image.data(), 6, 8, 20), std::invalid_argument);
  EXPECT_THROW(ImageView(image.data(), 6, 8, 26), std::invalid_argument);
}

}  // namespace
}  // namespace dsorb
