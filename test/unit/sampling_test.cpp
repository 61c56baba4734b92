// SPDX-License-Identifier: BSD-3-Clause
#include "estimate/sampling.h"

#include "base/random.h"

#include <gtest/gtest.h>

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
  const ImageSample sample = interpolate(level(), 7, 9);
  EXPECT_FLOAT_EQ(sample.intensity, level().at(7, 9).intensity);
  EXPECT_FLOAT_EQ(sample.dx, level().at(7, 9).dx);
  EXPECT_FLOAT_EQ(interpolateIntensity(level(), 7, 9), sample.intensity);
}

TEST_F(InterpolateTest, CellGradientIsTheDerivative) {
  const float x = 7.3F, y = 9.6F, step = 0.05F;
  const ImageSample sample = interpolateWithCellGradient(level(), x, y);
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

TEST_F(InterpolateTest, BorderRuleKeepsReadsInside) {
  EXPECT_TRUE(insideForInterpolation(level(), 0, 0));
  EXPECT_FALSE(insideForInterpolation(level(), 31, 5));
  EXPECT_TRUE(insideForInterpolation(level(), 30.99F, 22.99F));
  EXPECT_FALSE(insideForInterpolation(level(), -0.01F, 5));
  EXPECT_FALSE(insideForInterpolation(level(), 1.9F, 5, 2));
}

}  // namespace
}  // namespace dsorb
