// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/photometric/outlier_filter.h"

#include "dsorb/options/initializer.h"

#include "init/orb/photometric/neighbour_disagreement.h"
#include "init/orb/photometric/photometric_adjustment.h"
#include "init/orb/photometric/photometric_covariance.h"
#include "support/depth_windows.h"

#include <gtest/gtest.h>

#include <iostream>
#include <utility>

namespace dsorb::init_orb {
namespace {

TEST(NeighbourDisagreement, IsLargeForALonePointAndSmallBesideADepthEdge) {
  std::vector<Eigen::Vector2f> pixels;
  std::vector<double> inverse_depths;
  for (int y = 0; y < 100; y += 8) {
    for (int x = 0; x < 100; x += 8) {
      pixels.emplace_back(static_cast<float>(x), static_cast<float>(y));
      inverse_depths.push_back(x < 50 ? 1.0 : 2.0);
    }
  }
  const std::size_t alone = 30;
  inverse_depths[alone] = 6;
  const std::vector<double> disagreement = neighbourDisagreement(pixels, inverse_depths, 60);
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    if (i == alone) {
      EXPECT_GT(disagreement[i], 1.0);
    } else {
      EXPECT_LT(disagreement[i], 1e-12) << i;
    }
  }
  EXPECT_EQ(neighbourDisagreement({{0, 0}, {1, 1}}, {1, 5}, 60), (std::vector<double>{0, 0}));
}

/// Outliers and good points before and after a filter, depth errors before and after filter and
/// second adjustment; summed or averaged over windows.
struct FilterEffect {
  int windows = 0;
  int outliers = 0;
  int removed = 0;
  int good = 0;
  int lost = 0;
  double median_before = 0;
  double median_after = 0;
  double nees = 0;

  [[nodiscard]] double removedShare() const { return removed / std::max(1.0, 1.0 * outliers); }
  [[nodiscard]] double lostShare() const { return lost / std::max(1.0, 1.0 * good); }
};

FilterEffect effectOn(const std::vector<DepthWindow>& windows) {
  const InitializerOptions options;
  const PhotometricOptions& photometric = options.orb.photometric;
  FilterEffect effect;
  for (const DepthWindow& window : windows) {
    std::optional<InitialMap> map = mapOf(window, options);
    if (!map) continue;  // the start was refused
    PhotometricProblem problem = makeProblem(*map, window.camera, photometric);
    EXPECT_TRUE(adjustPhotometry(*map, problem, window.camera, photometric).usable);
    const DepthQuality before = judge(*map, window);
    removeOutliers(*map, problem, options.orb.outlier_rule);
    const DepthQuality filtered = judge(*map, window);
    const PhotometricReport report = adjustPhotometry(*map, problem, window.camera, photometric);
    EXPECT_TRUE(report.usable);
    map = withPhotometricVariances(
        std::move(*map), std::move(problem), photometric.poses == PhotometricPoses::kFree);
    if (!map) {
      ADD_FAILURE() << "degenerate equations";
      continue;
    }
    const DepthQuality after = judge(*map, window);
    ++effect.windows;
    effect.outliers += before.outliers;
    effect.removed += before.outliers - filtered.outliers;
    effect.good += before.good();
    effect.lost += before.good() - filtered.good();
    effect.median_before += before.median;
    effect.median_after += after.median;
    effect.nees += after.nees;
  }
  const double n = std::max(effect.windows, 1);
  effect.median_before /= n;
  effect.median_after /= n;
  effect.nees /= n;
  std::cout << effect.windows << " windows, median depth error " << effect.median_before << " -> "
            << effect.median_after << ", removed " << effect.removedShare() << " of "
            << effect.outliers << " outliers, lost " << effect.lostShare() << " of " << effect.good
            << " good points, error^2/variance " << effect.nees << "\n";
  return effect;
}

std::vector<DepthWindow> roomWindows() {
  std::vector<DepthWindow> windows;
  for (const std::uint64_t seed : {1U, 2U, 3U, 4U}) {
    synthetic::SequenceOptions options;
    options.seed = seed;
    options.length = 14;
    options.noise_sigma = 2;
    options.exposure_changes = 0.1;
    windows.push_back(renderedWindow(synthetic::SyntheticSequence(options), 0, 12));
  }
  return windows;
}

/// Bounds are the aims. Measured in the rooms and on TartanAir: 0.81 and 0.63 of the outliers
/// removed, 0.022 and 0.039 of the good points lost, error^2/variance 0.29 and 0.60.
/// @param windows that start at the least: which one of few frames is refused is decided by a hair,
/// and otherwise on another processor (5 or 6 of TartanAir's 7)
void expectHelpful(const FilterEffect& effect, int windows) {
  EXPECT_GE(effect.windows, windows);
  EXPECT_GE(effect.removedShare(), 0.5);
  EXPECT_LE(effect.lostShare(), 0.08);
  EXPECT_LE(effect.median_after, effect.median_before);
  EXPECT_GT(effect.nees, 0.2);
  EXPECT_LT(effect.nees, 1.0);
}

TEST(OutlierFilter, RemovesHalfOfTheOutliersAndFewGoodPointsInARoomWithOcclusions) {
  expectHelpful(effectOn(roomWindows()), 3);
}

TEST(OutlierFilter, RemovesHalfOfTheOutliersAndFewGoodPointsOnTartanAir) {
  if (!std::filesystem::exists(realData("tartanair_hospital"))) {
    GTEST_SKIP() << "no " << realData("tartanair_hospital");
  }
  std::vector<DepthWindow> windows;
  for (int first = 0; first + 12 <= 90; first += 12) {
    windows.push_back(realWindow("tartanair_hospital", first, 12));
  }
  expectHelpful(effectOn(windows), 4);
}

}  // namespace
}  // namespace dsorb::init_orb
