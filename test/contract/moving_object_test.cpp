// SPDX-License-Identifier: BSD-3-Clause
// A box that moves by itself must neither turn the estimated motion nor end up in the map.
#include "support/init_run.h"

#include <Eigen/Core>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <string>
#include <tuple>

namespace dsorb {
namespace {

using synthetic::SequenceKind;

synthetic::SequenceOptions trafficStreet(std::uint64_t seed, bool with_box) {
  synthetic::SequenceOptions options;
  options.kind = SequenceKind::kStreet;
  options.length = 12;
  options.seed = seed;
  options.noise_sigma = 1;
  options.moving_object = with_box;
  options.moving_object_share = with_box ? 0.1 : 0;
  return options;
}

InitRun start(const RenderedSequence& sequence) {
  return feed(*makeInitializer(initializerVariant("orb"), sequence.camera()), sequence.frames());
}

/// Share of the points of a result that lie on what only one of two scenes shows.
double shareOnBox(const InitializationResult& result,
                  const RenderedSequence& with,
                  const RenderedSequence& without) {
  const int reference = result.frames.front().frame->id().value;
  const std::vector<float> with_box = with.inverseDepth(reference);
  const std::vector<float> without_box = without.inverseDepth(reference);
  int on_box = 0;
  for (const InitPoint& point : result.points) {
    const auto x = static_cast<std::size_t>(std::lround(point.pixel.x()));
    const auto y = static_cast<std::size_t>(std::lround(point.pixel.y()));
    const std::size_t pixel = y * static_cast<std::size_t>(with.camera().width) + x;
    on_box += with_box[pixel] != without_box[pixel] ? 1 : 0;
  }
  return on_box / static_cast<double>(result.points.size());
}

/// Direction of the newest frame's translation less the true one, both of length 1.
Eigen::Vector3d directionError(const InitializationResult& result,
                               const RenderedSequence& sequence) {
  const SE3 truth = sequence.pose(result.frames.back().frame->id().value).inverse() *
                    sequence.pose(result.frames.front().frame->id().value);
  return result.frames.back().T_cam_ref->translation().normalized() -
         truth.translation().normalized();
}

class MovingObject : public testing::TestWithParam<std::uint64_t> {};

TEST_P(MovingObject, NeitherTurnsTheMotionNorEntersTheMap) {
  const RenderedSequence& with = rendered(trafficStreet(GetParam(), true));
  const RenderedSequence& without = rendered(trafficStreet(GetParam(), false));
  const InitRun moving = start(with);
  const InitRun still = start(without);
  ASSERT_TRUE(moving.result) << moving.log();
  ASSERT_TRUE(still.result) << still.log();
  const Eigen::Vector3d change =
      directionError(*moving.result, with) - directionError(*still.result, without);
  const double effect_deg = change.norm() * 180 / M_PI;
  const double share_on_box = shareOnBox(*moving.result, with, without);
  RecordProperty("effect_deg", std::to_string(effect_deg));
  RecordProperty("share_on_box", std::to_string(share_on_box));
  // Measured at most 0.11 degrees and 0.1 % of the points, earlier versions 0.16 and 0.6.
  EXPECT_LT(effect_deg, 0.5);
  EXPECT_LE(share_on_box, 0.02);
}

INSTANTIATE_TEST_SUITE_P(Streets, MovingObject, testing::Values(1, 2, 3));

/// Traffic of a fifth of the image at 12 km/h, with and without texture.
class Traffic : public testing::TestWithParam<std::tuple<std::uint64_t, bool>> {
 protected:
  /// @param own speed of the camera over that of the traffic
  [[nodiscard]] static synthetic::SequenceOptions traffic(double own) {
    synthetic::SequenceOptions options = trafficStreet(std::get<0>(GetParam()), true);
    options.length = 16;
    options.moving_object_share = 0.2;
    options.moving_object_plain = std::get<1>(GetParam());
    options.speed = 0.3;
    options.camera_speed = own;
    return options;
  }
};

TEST_P(Traffic, AStandingCarNeverStarts) {
  const InitRun run = start(rendered(traffic(0)));
  EXPECT_FALSE(run.result) << run.log();
}

TEST_P(Traffic, ACreepingCarDoesNotStartWrong) {
  const RenderedSequence& sequence = rendered(traffic(0.2));
  const InitRun run = start(sequence);
  if (!run.result) return;  // 7 cm a frame: it may wait
  const double direction_deg = startErrors(*run.result, sequence).direction_deg;
  RecordProperty("frames", static_cast<int>(run.steps.size()));
  RecordProperty("direction_deg", std::to_string(direction_deg));
  EXPECT_LT(direction_deg, 2) << run.log();  // measured at most 1.04 over 12 seeds
}

TEST_P(Traffic, ADrivingCarStartsRight) {
  const RenderedSequence& sequence = rendered(traffic(1));
  const InitRun run = start(sequence);
  ASSERT_TRUE(run.result) << run.log();
  const double direction_deg = startErrors(*run.result, sequence).direction_deg;
  RecordProperty("frames", static_cast<int>(run.steps.size()));
  RecordProperty("direction_deg", std::to_string(direction_deg));
  EXPECT_LT(direction_deg, 0.6);  // measured at most 0.30 over 12 seeds
}

INSTANTIATE_TEST_SUITE_P(Streets,
                         Traffic,
                         testing::Combine(testing::Values(1, 2, 3), testing::Bool()));

/// A van over half of the image that keeps its distance: nothing tells which of both motions is
/// that of the world.
class VanAhead : public testing::TestWithParam<std::uint64_t> {};

TEST_P(VanAhead, IsNotTheWorld) {
  synthetic::SequenceOptions options = trafficStreet(GetParam(), true);
  options.moving_object_share = 0.5;
  const RenderedSequence& sequence = rendered(options);
  const InitRun run = start(sequence);
  if (!run.result) return;  // it may wait
  EXPECT_LT(startErrors(*run.result, sequence).direction_deg, 2) << run.log();
}

INSTANTIATE_TEST_SUITE_P(Streets, VanAhead, testing::Values(11, 14, 16));

TEST(MovingObjects, ATurningCameraNeverStarts) {
  synthetic::SequenceOptions options;
  options.kind = SequenceKind::kRotation;
  options.length = 20;
  options.noise_sigma = 1;
  options.moving_object = true;
  const InitRun run = start(rendered(options));
  EXPECT_FALSE(run.result) << run.log();
}

}  // namespace
}  // namespace dsorb
