// SPDX-License-Identifier: BSD-3-Clause
#include "estimate/sampling.h"

#include "base/random.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <memory>
#include <vector>

namespace dsorb {
namespace {

class InterpolateTest : public testing::Test {
 protected:
  InterpolateTest() {
    Random random(7);
    std::vector<float> image(32 * 24);
    for (float& value : image) value = static_cast<float>(random.uniform(0, 255));
    pyramid_ = std::make_unique<Pyramid>(ImageView(image.data(), 32, 24));
  }
  const PyramidLevel& level() const { return pyramid_->level(0); }

 private:
  std::unique_ptr<Pyramid> pyramid_;
};

TEST_F(InterpolateTest, IsExactAtPixelCentres) {
  const Sample<float> sample = interpolate(level(), 7.0F, 9.0F);
  EXPECT_FLOAT_EQ(sample.intensity, level().at(7, 9).intensity);
  EXPECT_FLOAT_EQ(sample.dx, level().at(7, 9).dx);
  EXPECT_FLOAT_EQ(interpolateIntensity(level(), 7, 9), sample.intensity);
}

TEST_F(InterpolateTest, CellGradientIsTheDerivative) {
  const float x = 7.3F, y = 9.6F, step = 0.05F;
  const Sample<float> sample = interpolateWithCellGradient(level(), x, y);
  EXPECT_NEAR(sample.intensity, interpolateIntensity(level(), x, y), 1e-4);
  const float dx =
      (interpolateIntensity(level(), x + step, y) - interpolateIntensity(level(), x - step, y)) /
      (2 * step);
  const float dy =
      (interpolateIntensity(level(), x, y + step) - interpolateIntensity(level(), x, y - step)) /
      (2 * step);
  EXPECT_NEAR(sample.dx, dx, 1e-2);
  EXPECT_NEAR(sample.dy, dy, 1e-2);
}

TEST_F(InterpolateTest, AllFormsGiveTheSameNumbers) {
  const Lanes x = {1, 5.5F, 7.25F, 29, 12.125F, 3.75F, 20.5F, 28.875F};
  const Lanes y = {21, 1, 9.5F, 4.75F, 17.25F, 20.875F, 13, 2.5F};
  const LaneSamples eight = interpolateLanes(level().data(), level().width(), x, y);
  for (int k = 0; k < kLanes; ++k) {
    const Sample<float> one = interpolate(level(), x[k], y[k]);
    const Sample<double> precise =
        interpolate(level(), static_cast<double>(x[k]), static_cast<double>(y[k]));
    EXPECT_FLOAT_EQ(eight.intensity[k], one.intensity);
    EXPECT_FLOAT_EQ(eight.dx[k], one.dx);
    EXPECT_FLOAT_EQ(eight.dy[k], one.dy);
    EXPECT_NEAR(precise.intensity, static_cast<double>(one.intensity), 1e-4);
  }
}

TEST(InterpolateInvalidTest, AllFormsSayThatAPixelOfTheirsIsInvalid) {
  std::vector<float> image(32 * 24, 100.0F);
  image[10 * 32 + 12] = std::numeric_limits<float>::quiet_NaN();
  const Pyramid pyramid(ImageView(image.data(), 32, 24));
  const PyramidLevel& level = pyramid.level(0);
  // Its own cells; those whose central differences it is part of; those that do not know it.
  const Lanes x = {11.5F, 12.25F, 10.5F, 13.5F, 12.5F, 9.75F, 14.25F, 10.5F};
  const Lanes y = {9.5F, 10.75F, 10.5F, 9.5F, 8.5F, 10.5F, 10.5F, 8.5F};
  const bool valid[kLanes] = {false, false, false, false, false, true, true, true};
  const LaneSamples eight = interpolateLanes(level.data(), level.width(), x, y);
  for (int k = 0; k < kLanes; ++k) {
    const Sample<float> one = interpolate(level, x[k], y[k]);
    EXPECT_EQ(!std::isnan(one.intensity), valid[k]) << k;
    EXPECT_EQ(!std::isnan(eight.intensity[k]), valid[k]) << k;
    for (const float gradient : {one.dx, one.dy, eight.dx[k], eight.dy[k]}) {
      EXPECT_EQ(gradient, 0) << k;
    }
  }
}

TEST_F(InterpolateTest, BorderRuleKeepsReadsInside) {  // 32 x 24
  EXPECT_TRUE(canSample(level(), 1, 1));
  EXPECT_TRUE(canSample(level(), 29.99F, 21.99F));
  EXPECT_FALSE(canSample(level(), 30, 5));
  EXPECT_FALSE(canSample(level(), 5, 22));
  EXPECT_TRUE(canSample(level(), lastSample(32), lastSample(24)));
  EXPECT_FALSE(canSample(level(), 0.99F, 5));
  EXPECT_FALSE(canSample(level(), 2.9F, 5, 2));
  EXPECT_FALSE(canSample(level(), NAN, 5));
}

}  // namespace
}  // namespace dsorb
