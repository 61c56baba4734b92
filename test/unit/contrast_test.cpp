// SPDX-License-Identifier: BSD-3-Clause
#include "image/contrast.h"

#include "support/painted_frame.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <memory>
#include <vector>

namespace dsorb {
namespace {

constexpr int kPaintedWidth = 160;
constexpr int kPaintedHeight = 120;

FramePtr painted(const Paint& paint) {
  return paintFrame(0, kPaintedWidth, kPaintedHeight, paint);
}

Paint scaled(const Paint& scene, float gain, float offset) {
  return [=](float x, float y) { return gain * scene(x, y) + offset; };
}

FramePtr exposed(const Paint& paint, double seconds) {
  std::vector<float> pixels;
  for (int y = 0; y < kPaintedHeight; ++y) {
    for (int x = 0; x < kPaintedWidth; ++x) {
      pixels.push_back(paint(static_cast<float>(x), static_cast<float>(y)));
    }
  }
  return Frame::create({pixels.data(), kPaintedWidth, kPaintedHeight}, {FrameId{0}, 0, seconds});
}

TEST(Blank, IsWhatShowsNothingOfTheScene) {
  const Paint scene = blobs(1);
  const FramePtr full = painted(scene);
  EXPECT_TRUE(isBlank(*painted([](float, float) { return 0.0F; }), *full));
  EXPECT_TRUE(isBlank(*painted([](float, float) { return 255.0F; }), *full));
  EXPECT_TRUE(isBlank(*painted(scaled(scene, 0.05F, 100)), *full));
  EXPECT_TRUE(isBlank(
      *painted([](float, float) { return std::numeric_limits<float>::quiet_NaN(); }), *full));
  const auto random = std::make_shared<Random>(3);
  EXPECT_TRUE(isBlank(
      *painted([=](float, float) { return static_cast<float>(random->gaussian()) * 4 + 5; }),
      *full));
}

TEST(Blank, IsNoneThatIsOnlyDarker) {
  const Paint scene = blobs(1);
  const FramePtr full = painted(scene);
  EXPECT_FALSE(isBlank(*full, *full));
  EXPECT_FALSE(isBlank(*painted(scaled(scene, 0.2F, 0)), *full));
  EXPECT_FALSE(isBlank(*painted(blobs(2)), *full));
}

TEST(Blank, KnowsExposures) {
  const Paint scene = blobs(1);
  const Paint dark = scaled(scene, 0.05F, 0);
  EXPECT_TRUE(isBlank(*exposed(dark, 0.01), *exposed(scene, 0.01)));
  EXPECT_FALSE(isBlank(*exposed(dark, 0.01), *exposed(scene, 0.2)));
  EXPECT_FALSE(isBlank(*exposed(scene, 0.2), *exposed(scene, 0.01))) << "an automatic gain";
}

TEST(Blank, BesideABlankFrameIsNone) {
  const FramePtr black = painted([](float, float) { return 0.0F; });
  EXPECT_FALSE(isBlank(*black, *black));
}

}  // namespace
}  // namespace dsorb
