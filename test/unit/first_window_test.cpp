// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/first_window.h"

#include "dsorb/options/initializer.h"

#include "init/orb/start/essential_start.h"
#include "support/depth_windows.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

namespace dsorb::init_orb {
namespace {

constexpr int kWindowFrames = 8;

DepthWindow roomOf(std::uint64_t seed, double noise = 0) {
  synthetic::SequenceOptions options;
  options.seed = seed;
  options.length = kWindowFrames;
  options.noise_sigma = noise;
  return renderedWindow(synthetic::SyntheticSequence(options), 0, kWindowFrames);
}

/// A start of corners alone, from all frames.
std::optional<Reconstruction> cornersOf(const DepthWindow& window, const AttemptContext& context) {
  ReferencePool pool(context.options.orb, context.options.max_waiting_mb);
  pool.start(window.frames.front());
  for (std::size_t k = 1; k < window.frames.size(); ++k) pool.advance(window.frames[k]);
  Attempt start = startFromEssential(pool.view(0), context);
  if (!start.made) return std::nullopt;
  return std::move(*start.made);
}

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

TEST(FirstWindow, PointsAreAsGoodAsTheirVariancesSay) {
  const InitializerOptions options;
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    const DepthWindow window = roomOf(seed);
    StageClock clock;
    const AttemptContext context{window.camera, options, clock};
    auto start = cornersOf(window, context);
    ASSERT_TRUE(start);
    auto made = fillFirstWindow(std::move(*start), context);
    ASSERT_TRUE(made);
    const DepthQuality quality = judge(made->map, window);
    RecordProperty("points", quality.points);
    RecordProperty("median", std::to_string(quality.median));
    RecordProperty("nees", std::to_string(quality.nees));
    EXPECT_GT(quality.points, 1000) << seed;
    EXPECT_LT(quality.median, 0.02) << seed;
    EXPECT_GT(quality.within_10, 0.9) << seed;
    EXPECT_GT(quality.nees, 0.15) << seed;
    EXPECT_LT(quality.nees, 2) << seed;
  }
}

TEST(FirstWindow, CornersThatContradictTheirNeighboursGo) {
  const InitializerOptions options;
  const DepthWindow window = roomOf(4);
  StageClock clock;
  const AttemptContext context{window.camera, options, clock};
  auto start = cornersOf(window, context);
  ASSERT_TRUE(start);
  const std::size_t corners = start->map.corners.size();
  std::vector<Eigen::Vector2d> wrong;
  for (std::size_t i = 0; i < corners; i += 7) {
    start->map.corners[i].inverse_depth *= 1.6;
    wrong.push_back(start->map.corners[i].pixel);
  }
  auto made = fillFirstWindow(std::move(*start), context);
  ASSERT_TRUE(made);
  std::size_t left = 0;
  for (const Corner& corner : made->map.corners) {
    for (const Eigen::Vector2d& pixel : wrong) left += corner.pixel == pixel ? 1 : 0;
  }
  RecordProperty("left", static_cast<int>(left));
  RecordProperty("wrong", static_cast<int>(wrong.size()));
  RecordProperty("corners", static_cast<int>(made->map.corners.size()));
  EXPECT_LT(left, wrong.size() / 20);
  EXPECT_GT(made->map.corners.size(), (corners - wrong.size()) * 8 / 10);
}

TEST(FirstWindow, OutlierLimitsFollowTheNoiseOfTheImages) {
  const InitializerOptions options;
  const DepthWindow window = roomOf(5, 10);
  StageClock clock;
  const AttemptContext context{window.camera, options, clock};
  auto start = cornersOf(window, context);
  ASSERT_TRUE(start);
  const std::size_t corners = start->map.corners.size();
  auto made = fillFirstWindow(std::move(*start), context);
  ASSERT_TRUE(made);
  RecordProperty("before", static_cast<int>(corners));
  RecordProperty("after", static_cast<int>(made->map.corners.size()));
  EXPECT_GT(made->map.corners.size(), corners * 6 / 10);
}

}  // namespace
}  // namespace dsorb::init_orb
