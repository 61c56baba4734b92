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

TEST(Repeated, IsTheSameImageAndNotTheNextOne) {
  const Paint scene = blobs(1);
  const FramePtr before = painted(scene);
  const auto random = std::make_shared<Random>(3);
  const auto noisy = [&](float sigma) {
    return painted([=](float x, float y) {
      return scene(x, y) + sigma * static_cast<float>(random->gaussian());
    });
  };
  EXPECT_TRUE(isRepeated(*painted(scene), *before));
  EXPECT_TRUE(isRepeated(*noisy(0.2F), *before));
  EXPECT_FALSE(isRepeated(*noisy(1), *before)) << "a standing camera has noise of its own";
  EXPECT_FALSE(isRepeated(*painted(shifted(scene, 0.05F, 0)), *before));
  EXPECT_FALSE(isRepeated(*painted(scaled(scene, 1.02F, 0)), *before));
  const FramePtr black = painted([](float, float) { return 0.0F; });
  EXPECT_FALSE(isRepeated(*black, *black)) << "nothing is seen of any moment";
}

TEST(GreyScale, GivesImagesTheUsualContrastAndLeavesUsualOnes) {
  const Paint scene = blobs(1);
  EXPECT_FALSE(GreyScale::of(*painted(scene))->changes());
  for (const float gain : {0.03F, 0.1F, 5.0F}) {
    const FramePtr frame = painted(scaled(scene, gain, 20));
    const FramePtr usual = GreyScale::of(*frame)->apply(frame);
    EXPECT_FALSE(GreyScale::of(*usual)->changes()) << gain;
    EXPECT_EQ(usual->id(), frame->id());
  }
  EXPECT_FALSE(GreyScale::of(*painted([](float, float) { return 90.0F; })));
}

TEST(GreyScale, OfDarknessDoesNotSuitTheLight) {
  const auto scene = [](float x, float y) { return 120 + 60 * std::sin(x / 9) * std::cos(y / 7); };
  const auto dark = [&](float x, float y) { return 0.02F * scene(x, y); };
  const GreyScale scale = *GreyScale::of(*painted(dark));
  EXPECT_TRUE(scale.changes());
  EXPECT_TRUE(scale.suits(*painted(dark)));
  EXPECT_FALSE(scale.suits(*painted(scene)));
  EXPECT_FALSE((GreyScale{4, 118}.suits(*painted(scene)))) << "its mean would be 600";
  EXPECT_TRUE(GreyScale().suits(*painted(scene)));
}

TEST(GreyScale, DoesNotShowTheNoise) {
  const auto random = std::make_shared<Random>(3);
  const FramePtr frame = painted([=](float x, float) {
    return 100 + 3 * std::sin(0.05F * x) + 2 * static_cast<float>(random->gaussian());
  });
  const GreyScale scale = *GreyScale::of(*frame);
  EXPECT_NEAR(scale.gain, 2, 0.3) << "4 grey levels of noise at most";
}

}  // namespace
}  // namespace dsorb
