// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/photometric/residual_statistics.h"

#include "base/median.h"
#include "base/random.h"

#include <gtest/gtest.h>

#include <cmath>

namespace dsorb::init_orb {
namespace {

constexpr int kSamples = 20000;
constexpr double kNoPrefilter = 1e9;

double drawT(Random& random) {
  double chi_square = 0;
  for (int i = 0; i < static_cast<int>(kTDegrees); ++i) {
    const double normal = random.gaussian();
    chi_square += normal * normal;
  }
  return random.gaussian() / std::sqrt(chi_square / kTDegrees);
}

TEST(TDistribution, RecoversTheScaleOfDrawnSamples) {
  Random random(1);
  std::vector<float> residuals;
  for (int i = 0; i < kSamples; ++i) residuals.push_back(static_cast<float>(3.7 * drawT(random)));
  const TDistribution fit = fitTDistribution(residuals, kNoPrefilter);
  EXPECT_EQ(fit.samples, kSamples);
  EXPECT_NEAR(fit.scale, 3.7, 0.05);  // sigma / sqrt(2 n 5/8) = 0.023, margin x2
  // The prefilter cuts the tails of t-distributed residuals: 5 % at 3 x 1.376 / 1.4826 scales.
  const TDistribution filtered = fitTDistribution(residuals, 3);
  EXPECT_LT(filtered.samples, kSamples);
  EXPECT_NEAR(filtered.scale, 3.7, 0.4);
}

TEST(TDistribution, OfAGaussianIsNarrowerThanItsSigma) {
  Random random(2);
  std::vector<float> residuals;
  for (int i = 0; i < kSamples; ++i) residuals.push_back(static_cast<float>(2 * random.gaussian()));
  // .857 sigma is the fixed point of the integral.
  EXPECT_NEAR(fitTDistribution(residuals, kNoPrefilter).scale, 2 * 0.857, 0.03);
}

TEST(TDistribution, PrefilterSavesTheFitFromManyOutliers) {
  Random random(3);
  std::vector<float> residuals;
  for (int i = 0; i < kSamples; ++i) {
    residuals.push_back(
        static_cast<float>(i % 5 == 0 ? random.uniform(-50, 50) : random.gaussian()));
  }
  // 20 % are more than the fit can bear: its fixed point is 3.58.
  EXPECT_NEAR(fitTDistribution(residuals, kNoPrefilter).scale, 3.58, 0.2);
  EXPECT_NEAR(fitTDistribution(residuals, 3).scale, 1, 0.15);  // measured 1.04
}

TEST(TDistribution, QuantilesKeepWhatTheirNamesSay) {
  Random random(4);
  int inside_95 = 0;
  int inside_90 = 0;
  for (int i = 0; i < kSamples; ++i) {
    const double magnitude = std::abs(drawT(random));
    inside_95 += magnitude < 2.571 ? 1 : 0;
    inside_90 += magnitude < 2.015 ? 1 : 0;
  }
  EXPECT_NEAR(inside_95, 0.95 * kSamples, 0.005 * kSamples);
  EXPECT_NEAR(inside_90, 0.90 * kSamples, 0.007 * kSamples);
}

TEST(TDistribution, WeightsFallFromZeroOn) {
  const std::vector<float> residuals = {0, 2, -2 * 2.571F};
  const auto weight = [&](std::size_t i) { return sumOfTWeights(&residuals[i], 1, 2); };
  EXPECT_FLOAT_EQ(weight(0), 1.2F);
  EXPECT_FLOAT_EQ(weight(1), 1.0F);
  EXPECT_NEAR(weight(2), 0.517F, 0.001F);
  EXPECT_FLOAT_EQ(sumOfTWeights(residuals.data(), 3, 2), weight(0) + weight(1) + weight(2));
}

TEST(TDistribution, HasAScaleWhereHalfOfTheResidualsAreTheSame) {
  Random random(5);
  std::vector<float> residuals;
  for (int i = 0; i < kSamples; ++i) {
    residuals.push_back(i % 5 < 3 ? 0 : static_cast<float>(4 * random.gaussian()));
  }
  const TDistribution fit = fitTDistribution(residuals, 3);
  // 40 % have a sigma of 4: 2.53 together, 3 times that keeps 94 % of them.
  EXPECT_GT(fit.samples, 0.95 * kSamples);
  EXPECT_GT(fit.scale, 0.5);
  EXPECT_LT(fit.scale, 2.53);
  EXPECT_NEAR(fitTDistribution({0, 0, 0}, 3).scale, 0.29, 1e-6);  // of rounding
}

TEST(TDistribution, OfNothingIsZero) {
  EXPECT_EQ(fitTDistribution({}, 3).scale, 0);
  EXPECT_EQ(medianOf({}), 0);
}

}  // namespace
}  // namespace dsorb::init_orb
