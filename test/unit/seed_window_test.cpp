// SPDX-License-Identifier: BSD-3-Clause
#include "odometry/seed_window.h"

#include "base/median.h"
#include "support/matchers.h"
#include "support/odometry_run.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

namespace dsorb::odometry {
namespace {

/// True initializations of a rendered room.
class SeedWindow : public ::testing::Test {
 protected:
  static constexpr int kFrames = 6;
  static const World& room() {
    static const World world(synthetic::SequenceKind::kRoom, kFrames);
    return world;
  }
  /// @param cell side of the squares with one point each [px]
  [[nodiscard]] static InitializationResult resultWith(int cell) {
    return room().initialization(kFrames, cell);
  }
  [[nodiscard]] window::Window seed(const InitializationResult& result) const {
    const PinholeCamera& camera = room().camera();
    PixelSelector selector(camera.width, camera.height, {});
    return seedWindow(result, camera, options_, selector);
  }

  OdometryOptions options_;
};

TEST_F(SeedWindow, ReferenceAndNewestFrameBecomeKeyframesAtTheGivenPoses) {
  options_.window.first_keyframes = 2;
  const InitializationResult result = resultWith(8);
  const window::Window window = seed(result);
  ASSERT_EQ(window.keyframes.size(), 2U);
  EXPECT_EQ(window.keyframes[0].frame, result.frames.front().frame);
  EXPECT_EQ(window.keyframes[1].frame, result.frames.back().frame);
  EXPECT_THAT(window.keyframes[0].T_cam_world(), Se3Near(SE3(), 1e-12, 1e-12));
  EXPECT_THAT(window.keyframes[1].T_cam_world(),
              Se3Near(*result.frames.back().T_cam_ref, 1e-12, 1e-12));
}

TEST_F(SeedWindow, PosedFramesBetweenBecomeKeyframesThatSeeThePoints) {
  options_.window.first_keyframes = 4;
  options_.window.desired_points = 300;  // nothing is added
  InitializationResult result = resultWith(8);
  result.frames[3].T_cam_ref.reset();
  const window::Window window = seed(result);
  ASSERT_EQ(window.keyframes.size(), 3U) << "frame 3 has no pose";
  EXPECT_EQ(window.keyframes[1].frame, result.frames[2].frame);
  EXPECT_THAT(window.keyframes[1].T_cam_world(),
              Se3Near(*result.frames[2].T_cam_ref, 1e-12, 1e-12));
  for (const window::WindowPoint& point : window.keyframes[0].points) {
    EXPECT_EQ(point.num_observations, 2) << "one to each other keyframe";
  }
}

TEST_F(SeedWindow, ManyPointsAreThinnedAndNothingIsAdded) {
  options_.window.desired_points = 300;
  const InitializationResult result = resultWith(6);
  ASSERT_GT(result.points.size(), 600U);
  const window::Window window = seed(result);
  EXPECT_LE(window.numPoints(), 300U);
  EXPECT_GE(window.numPoints(), 200U);
}

TEST_F(SeedWindow, FewPointsAreFilledUpWithCandidatesNearTheTruth) {
  const InitializationResult result = resultWith(40);
  ASSERT_LT(result.points.size(), 60U);
  const window::Window window = seed(result);
  EXPECT_GT(window.numPoints(), 5 * result.points.size());
  const double unit = room().unitOf(result);
  const std::vector<float> truth = room().inverseDepth(0);
  std::vector<double> errors;
  for (const window::WindowPoint& point : window.keyframes[0].points) {
    const auto at = static_cast<std::size_t>(point.patch.pixel.y()) * 320U +
                    static_cast<std::size_t>(point.patch.pixel.x());
    const double expected = static_cast<double>(truth[at]) * unit;
    errors.push_back(std::abs(static_cast<double>(point.inverse_depth) / expected - 1));
  }
  EXPECT_LT(medianOf(errors), 0.05);
}

TEST_F(SeedWindow, NothingIsAddedWhereTheImageMovesWithTheCamera) {
  const auto added_below = [this](const InitializationResult& result) {
    const window::Window window = seed(result);
    return std::count_if(window.keyframes[0].points.begin(),
                         window.keyframes[0].points.end(),
                         [](const auto& point) { return point.patch.pixel.y() >= 192; });
  };
  InitializationResult result = resultWith(40);
  const auto given = std::count_if(result.points.begin(),
                                   result.points.end(),
                                   [](const InitPoint& point) { return point.pixel.y() >= 192; });
  EXPECT_GT(added_below(result), 2 * given);
  for (float x = 8; x < 320; x += 16) {
    for (float y = 200; y < 240; y += 16) result.stuck.emplace_back(x, y);
  }
  EXPECT_LE(added_below(result), given);
}

TEST_F(SeedWindow, UnknownVariancesGiveNoPrior) {
  InitializationResult result = resultWith(8);
  for (InitPoint& point : result.points) point.variance = 0;
  const window::Window window = seed(result);
  for (const window::WindowPoint& point : window.keyframes[0].points) {
    EXPECT_EQ(point.prior_information, 0.0F);
  }
}

TEST_F(SeedWindow, HostsBetweenBecomeKeyframesWithTheirPoints) {
  options_.window.first_keyframes = 2;
  InitializationResult result = resultWith(8);
  for (std::size_t i = 0; i < result.points.size(); i += 3) result.points[i].host = 2;
  const window::Window window = seed(result);
  ASSERT_EQ(window.keyframes.size(), 3U);
  EXPECT_EQ(window.keyframes[1].frame, result.frames[2].frame);
  EXPECT_FALSE(window.keyframes[1].points.empty());
  for (const window::WindowPoint& point : window.keyframes[1].points) {
    EXPECT_EQ(point.num_observations, 2) << "one to each other keyframe";
  }
}

TEST_F(SeedWindow, OfTooManyHostsThoseWithTheMostPointsStay) {
  options_.window.max_keyframes = 4;
  options_.window.desired_points = 100;  // nothing is added
  InitializationResult result = resultWith(8);
  const std::vector<int> hosts = {0, 3, 1, 3, 2, 1, 3, 1, 3, 4};  // 3 most often, then 1
  for (std::size_t i = 0; i < result.points.size(); ++i) {
    result.points[i].host = hosts[i % hosts.size()];
  }
  const window::Window window = seed(result);
  std::vector<int> ids;
  for (const window::Keyframe& keyframe : window.keyframes) {
    ids.push_back(keyframe.frame->id().value);
  }
  EXPECT_EQ(ids, (std::vector<int>{0, 1, 3, kFrames - 1}));
  for (const std::size_t host : {0U, 1U, 2U}) EXPECT_FALSE(window.keyframes[host].points.empty());
  EXPECT_TRUE(window.keyframes.back().points.empty()) << "nobody else's points";
}

}  // namespace
}  // namespace dsorb::odometry
