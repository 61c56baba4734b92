// SPDX-License-Identifier: BSD-3-Clause
#include "image/pixel_selector.h"

#include "base/random.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <set>
#include <utility>
#include <vector>

namespace dsorb {
namespace {

constexpr int kWidth = 320;
constexpr int kHeight = 240;

FramePtr makeFrame(const std::vector<float>& grey,
                   int width,
                   std::shared_ptr<const ResponseSlope> slope = nullptr) {
  const int height = static_cast<int>(grey.size()) / width;
  return Frame::create(ImageView(grey.data(), width, height), {FrameId{0}, 0, 1, std::move(slope)});
}

/// Smooth random texture: sum of waves with random directions.
std::vector<float> texture(int width, int height, double amplitude, std::uint64_t seed) {
  Random random(seed);
  std::vector<float> grey(static_cast<std::size_t>(width * height), 128.0F);
  for (int wave = 0; wave < 20; ++wave) {
    const double kx = random.uniform(-0.9, 0.9);
    const double ky = random.uniform(-0.9, 0.9);
    const double phase = random.uniform(0, 6.3);
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        grey[static_cast<std::size_t>(y * width + x)] +=
            static_cast<float>(amplitude * std::sin(kx * x + ky * y + phase));
      }
    }
  }
  return grey;
}

/// Horizontal ramp: gradient of `slope` grey levels / px everywhere.
std::vector<float> ramp(int width, int height, float slope) {
  std::vector<float> grey;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      grey.push_back(slope * static_cast<float>(x));
    }
  }
  return grey;
}

TEST(RegionThresholds, AreTheMedianGradientPlusAConstantSquared) {
  RegionThresholds thresholds;
  thresholds.compute(*makeFrame(ramp(kWidth, kHeight, 3.5F), kWidth));
  for (const auto& [x, y] : {std::pair{5, 5}, {160, 120}, {319, 239}}) {
    EXPECT_FLOAT_EQ(thresholds.squaredThreshold(x, y), 100.0F) << x << ' ' << y;  // (3 + 7)^2
  }
  EXPECT_FLOAT_EQ(thresholds.squaredGradients(100)[100], 12.25F);
}

TEST(RegionThresholds, StripsBesideTheLastRegionUseIt) {
  // Right half steep: a strip that read the next row's first region would get the flat threshold.
  const int width = 6 * 32 + 16;
  std::vector<float> grey = ramp(width, 112, 1.0F);
  for (int y = 0; y < 112; ++y) {
    for (int x = 0; x < width; ++x) {
      grey[static_cast<std::size_t>(y * width + x)] =
          x < width / 2 ? 0.0F : 20.0F * static_cast<float>(x - width / 2);
    }
  }
  RegionThresholds thresholds;
  thresholds.compute(*makeFrame(grey, width));
  EXPECT_FLOAT_EQ(thresholds.squaredThreshold(width - 1, 50),
                  thresholds.squaredThreshold(5 * 32 + 1, 50));
  EXPECT_FLOAT_EQ(thresholds.squaredThreshold(width - 1, 50), 27.0F * 27.0F);
  EXPECT_FLOAT_EQ(thresholds.squaredThreshold(width - 1, 111), 27.0F * 27.0F);
  EXPECT_FLOAT_EQ(thresholds.squaredThreshold(1, 50), 49.0F);
}

TEST(RegionThresholds, WeighGradientsByTheResponseSlope) {
  auto slope = std::make_shared<ResponseSlope>();
  slope->fill(0.5F);
  RegionThresholds thresholds;
  thresholds.compute(*makeFrame(ramp(kWidth, kHeight, 8.0F), kWidth, slope));
  EXPECT_FLOAT_EQ(thresholds.squaredGradients(100)[100], 16.0F);
  EXPECT_FLOAT_EQ(thresholds.squaredThreshold(100, 100), 121.0F);  // (4 + 7)^2
}

TEST(RegionThresholds, InvalidPixelsDoNotVote) {
  std::vector<float> grey = ramp(kWidth, kHeight, 5.0F);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < 24; ++x) {  // three quarters of the first column of regions
      grey[static_cast<std::size_t>(y * kWidth + x)] = std::numeric_limits<float>::quiet_NaN();
    }
  }
  RegionThresholds thresholds;
  thresholds.compute(*makeFrame(grey, kWidth));
  EXPECT_FLOAT_EQ(thresholds.squaredThreshold(5, 100), 144.0F);  // (5 + 7)^2
}

TEST(PixelSelector, FindsTheWantedNumberInTexture) {
  // Measured 1.02 to 1.05 of the wanted number; margin x3.
  const FramePtr frame = makeFrame(texture(kWidth, kHeight, 6, 1), kWidth);
  for (const int wanted : {200, 600, 2000}) {
    PixelSelector selector(kWidth, kHeight, {});
    const auto found = static_cast<double>(selector.select(*frame, wanted).size());
    EXPECT_GT(found, 0.85 * wanted) << wanted;
    EXPECT_LT(found, 1.15 * wanted) << wanted;
  }
}

TEST(PixelSelector, WithoutAWishThereIsAtLeastOne) {
  const FramePtr frame = makeFrame(texture(kWidth, kHeight, 6, 1), kWidth);
  for (const int wanted : {0, -3}) {
    PixelSelector selector(kWidth, kHeight, {});
    PixelSelector one(kWidth, kHeight, {});
    EXPECT_EQ(selector.select(*frame, wanted).size(), one.select(*frame, 1).size()) << wanted;
  }
}

TEST(PixelSelector, PixelsPassTheirThresholdAndStayOffTheBorder) {
  const FramePtr frame = makeFrame(texture(kWidth, kHeight, 6, 2), kWidth);
  PixelSelector selector(kWidth, kHeight, {});
  const std::vector<SelectedPixel> selected = selector.select(*frame, 600, 2.0F);
  std::set<std::pair<int, int>> places;
  for (const SelectedPixel& pixel : selected) {
    ASSERT_TRUE(pixel.x >= 4 && pixel.x < kWidth - 5 && pixel.y >= 4 && pixel.y <= kHeight - 4);
    ASSERT_TRUE(places.insert({pixel.x, pixel.y}).second) << "selected twice";
    const int level = pixel.type == 1 ? 0 : pixel.type == 2 ? 1 : 2;
    const double share = level == 0 ? 1.0 : level == 1 ? 0.75 : 0.421875;
    const ImageSample sample = frame->level(level).at(pixel.x >> level, pixel.y >> level);
    EXPECT_GT(sample.dx * sample.dx + sample.dy * sample.dy,
              2.0 * share * selector.thresholds().squaredThreshold(pixel.x, pixel.y));
  }
}

TEST(PixelSelector, CoarserScalesFillWhereFineGradientsAreMissing) {
  // Slope 1.5 on level 0 and 3 on level 1: too flat; 6 on level 2 passes sqrt(0.42) * 7.
  std::vector<float> grey;
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      grey.push_back(static_cast<float>(128.0 + 18.0 * std::tanh((x - 160) / 12.0)));
    }
  }
  PixelSelector selector(kWidth, kHeight, {});
  const std::vector<SelectedPixel> selected = selector.select(*makeFrame(grey, kWidth), 200);
  ASSERT_FALSE(selected.empty());
  for (const SelectedPixel& pixel : selected) {
    EXPECT_EQ(pixel.type, 4);
    EXPECT_NEAR(pixel.x, 160, 24);
  }
}

TEST(PixelSelector, ReturnsNothingWithoutGradientsOrWithoutValidPixels) {
  const std::vector<float> flat(static_cast<std::size_t>(kWidth * kHeight), 100.0F);
  const std::vector<float> invalid(static_cast<std::size_t>(kWidth * kHeight),
                                   std::numeric_limits<float>::quiet_NaN());
  PixelSelector selector(kWidth, kHeight, {});
  EXPECT_TRUE(selector.select(*makeFrame(flat, kWidth), 500).empty());
  EXPECT_TRUE(selector.select(*makeFrame(invalid, kWidth), 500).empty());
}

TEST(PixelSelector, RecoversItsDensityAfterASceneChange) {
  PixelSelector selector(kWidth, kHeight, {});
  const FramePtr rich = makeFrame(texture(kWidth, kHeight, 8, 3), kWidth);
  std::vector<float> half = texture(kWidth, kHeight, 8, 4);
  for (std::size_t i = 0; i < half.size(); ++i) {
    if (i % kWidth > 80) half[i] = 100.0F;  // texture in a quarter only
  }
  selector.select(*rich, 100);
  const int coarse = selector.blockSize();
  const std::size_t found = selector.select(*makeFrame(half, kWidth), 400).size();
  EXPECT_LT(selector.blockSize(), coarse);
  EXPECT_GT(found, 320U);  // at once, not one frame later
}

TEST(PixelSelector, SameSeedGivesSamePixelsAndAnotherSeedOthers) {
  const FramePtr frame = makeFrame(texture(kWidth, kHeight, 6, 5), kWidth);
  const auto places = [&](int seed) {
    PixelSelectorOptions options;
    options.seed = seed;
    std::set<std::pair<int, int>> result;
    for (const SelectedPixel& p : PixelSelector(kWidth, kHeight, options).select(*frame, 400)) {
      result.insert({p.x, p.y});
    }
    return result;
  };
  EXPECT_EQ(places(1), places(1));
  EXPECT_NE(places(1), places(2));
}

TEST(PixelSelector, SelectsLikeAFreshOneAfterAReset) {
  const auto places = [](const std::vector<SelectedPixel>& pixels) {
    std::vector<std::pair<int, int>> result;
    result.reserve(pixels.size());
    for (const SelectedPixel& pixel : pixels) result.emplace_back(pixel.x, pixel.y);
    return result;
  };
  const FramePtr frame = makeFrame(texture(kWidth, kHeight, 6, 5), kWidth);
  const auto fresh = places(PixelSelector(kWidth, kHeight, {}).select(*frame, 2000));
  PixelSelector used(kWidth, kHeight, {});
  used.select(*makeFrame(texture(kWidth, kHeight, 8, 3), kWidth), 100);
  used.reset();
  EXPECT_EQ(places(used.select(*frame, 2000)), fresh);
}

TEST(PixelSelector, RefusesAFrameOfAnotherSize) {
  PixelSelector selector(kWidth, kHeight, {});
  const FramePtr other = makeFrame(texture(160, 120, 6, 6), 160);
  EXPECT_THROW(selector.select(*other, 100), std::invalid_argument);
}

TEST(GridMaxima, ApproachesTheWantedNumberAndCountsPixelsOnce) {
  const FramePtr frame = makeFrame(texture(kWidth, kHeight, 8, 7), kWidth);
  const GridSelection selection = selectGridMaxima(frame->level(1), 500, 5);
  EXPECT_GT(selection.pixels.size(), 300U);
  EXPECT_LT(selection.pixels.size(), 800U);
  std::set<std::pair<int, int>> places;
  for (const SelectedPixel& pixel : selection.pixels) {
    EXPECT_TRUE(places.insert({pixel.x, pixel.y}).second);
    const ImageSample sample = frame->level(1).at(pixel.x, pixel.y);
    EXPECT_GT(std::hypot(sample.dx, sample.dy), 7.5F);
  }
}

TEST(PatchMaxima, ArePixelsOfLargestGradientInTheirPatch) {
  const FramePtr frame = makeFrame(texture(kWidth, kHeight, 6, 8), kWidth);
  RegionThresholds thresholds;
  thresholds.compute(*frame);
  const std::vector<SelectedPixel> selected = selectPatchMaxima(*frame, thresholds, 6);
  ASSERT_GT(selected.size(), 100U);
  std::set<std::pair<int, int>> patches;
  for (const SelectedPixel& pixel : selected) {
    EXPECT_TRUE(patches.insert({pixel.x / 6, pixel.y / 6}).second) << "two in one patch";
    const float own = thresholds.squaredGradients(pixel.y)[pixel.x];
    EXPECT_GT(own, thresholds.squaredThreshold(pixel.x, pixel.y));
    for (int y = std::max(pixel.y / 6 * 6, 3); y < std::min(pixel.y / 6 * 6 + 6, kHeight - 3);
         ++y) {
      for (int x = std::max(pixel.x / 6 * 6, 3); x < std::min(pixel.x / 6 * 6 + 6, kWidth - 3);
           ++x) {
        EXPECT_LE(thresholds.squaredGradients(y)[x], own);
      }
    }
  }
}

TEST(PatchMaxima, KeepThePatternOffInvalidPixels) {
  std::vector<float> grey = texture(kWidth, kHeight, 8, 9);
  for (int y = 0; y < kHeight; ++y) {
    grey[static_cast<std::size_t>(y * kWidth + 100)] = std::numeric_limits<float>::quiet_NaN();
  }
  const FramePtr frame = makeFrame(grey, kWidth);
  RegionThresholds thresholds;
  thresholds.compute(*frame);
  for (const SelectedPixel& pixel : selectPatchMaxima(*frame, thresholds, 6)) {
    EXPECT_TRUE(patternIsValid(frame->level(0), pixel.x, pixel.y));
    EXPECT_GE(std::abs(pixel.x - 100), 2);
  }
  EXPECT_FALSE(patternIsValid(frame->level(0), 102, 50));
  EXPECT_TRUE(patternIsValid(frame->level(0), 103, 50));
  EXPECT_FALSE(patternIsValid(frame->level(0), 1, 50));
}

}  // namespace
}  // namespace dsorb
