// SPDX-License-Identifier: BSD-3-Clause
#include "published/orb_initializer.h"
#include "support/init_run.h"

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>

namespace dsorb::published {
namespace {

using synthetic::SequenceKind;
using synthetic::SequenceOptions;

SequenceOptions small(SequenceKind kind, int length) {
  SequenceOptions options;
  options.kind = kind;
  options.length = length;
  options.width = 320;
  options.height = 240;
  return options;
}

InitRun run(const InitializerOptions& options,
            const PinholeCamera& camera,
            const std::vector<FramePtr>& frames) {
  ORBInitializer initializer(Version::kMatching, options, camera);
  return feed(initializer, frames);
}

/// The same view out of focus.
FramePtr blurred(const Frame& frame, double sigma) {
  cv::Mat image(frame.height(), frame.width(), CV_32FC1);
  for (int y = 0; y < frame.height(); ++y) {
    for (int x = 0; x < frame.width(); ++x) {
      image.at<float>(y, x) = frame.level(0).at(x, y).intensity;
    }
  }
  cv::GaussianBlur(image, image, {}, sigma);
  return Frame::create({image.ptr<float>(), frame.width(), frame.height()},
                       {frame.id(), frame.timestamp(), frame.exposure(), nullptr});
}

TEST(MatchingInitializer, FindsPosesByDescriptors) {
  const RenderedSequence& street = rendered(small(SequenceKind::kStreet, 8));
  const InitRun result = run({}, street.camera(), street.frames());
  ASSERT_TRUE(result.result) << result.log();
  EXPECT_EQ(result.result->report.detail("optical_flow"), 0);
  const StartErrors errors = startErrors(*result.result, street);
  EXPECT_LT(errors.direction_deg, 3.0);  // measured 1.6, 0.21 and 0.086; margin x2
  EXPECT_LT(errors.rotation_deg, 0.4);
  EXPECT_LT(errors.median_relative_depth, 0.17);
}

TEST(MatchingInitializer, FollowsOpticalFlowWhereDescriptorsFail) {
  SequenceOptions tiny = small(SequenceKind::kRoom, 16);
  tiny.width = 128;  // no hundred features match
  tiny.height = 96;
  const RenderedSequence& room = rendered(tiny);
  const InitRun result = run({}, room.camera(), room.frames());
  ASSERT_TRUE(result.result) << result.log();
  EXPECT_EQ(result.result->report.detail("optical_flow"), 1);
  const StartErrors errors = startErrors(*result.result, room);
  EXPECT_LT(errors.direction_deg, 1.5);  // measured 0.71 and 0.073; margin x2
  EXPECT_LT(errors.rotation_deg, 0.15);
}

TEST(MatchingInitializer, ChangesToOpticalFlowBetweenFrames) {
  const RenderedSequence& room = rendered(small(SequenceKind::kRoom, 16));
  Features pair(2000, true);
  pair.start(room.frames()[0]);
  pair.track(room.frames()[1]);
  EXPECT_FALSE(pair.usesFlow());
  pair.track(blurred(*room.frames()[2], 4));
  EXPECT_FALSE(pair.cut());
  ASSERT_TRUE(pair.usesFlow());
  EXPECT_EQ(pair.frames().size(), 3U);
  EXPECT_EQ(pair.tracks().frames(), 3);
  EXPECT_EQ(pair.tracks().size(), pair.size());
}

TEST(MatchingInitializer, AFeatureCanMissInFramesBetween) {
  const RenderedSequence& room = rendered(small(SequenceKind::kRoom, 16));
  Features pair(2000, true);
  pair.start(room.frames()[0]);
  for (std::size_t k = 1; k < 5; ++k) pair.track(room.frames()[k]);
  ASSERT_FALSE(pair.usesFlow());
  const CornerTracks tracks = pair.tracks();
  EXPECT_EQ(tracks.size(), pair.size());
  EXPECT_TRUE(
      std::all_of(tracks.positions.front().begin(), tracks.positions.front().end(), isSeen));
  EXPECT_TRUE(std::all_of(tracks.positions.back().begin(), tracks.positions.back().end(), isSeen));
  EXPECT_FALSE(std::all_of(tracks.positions[2].begin(), tracks.positions[2].end(), isSeen));
}

TEST(MatchingInitializer, StartsAfreshWithTheFrameOfAFailedPair) {
  const RenderedSequence& room = rendered(small(SequenceKind::kRoom, 16));
  std::vector<FramePtr> frames;
  for (const FramePtr& frame : room.frames()) frames.push_back(blurred(*frame, 4));
  InitializerOptions options;
  options.published.max_corners = 50;  // too few of them fit
  options.published.min_tracked = 8;
  const InitRun result = run(options, room.camera(), frames);
  EXPECT_FALSE(result.result);
  std::vector<std::size_t> restarts;
  for (std::size_t i = 0; i < result.steps.size(); ++i) {
    if (result.steps[i].status == InitStatus::kRestarted) restarts.push_back(i);
  }
  ASSERT_GE(restarts.size(), 2U) << result.log();
  EXPECT_EQ(result.steps[restarts[0]].reason, InitReason::kTooFewPoints);
  // The frame of the failure is the new reference, so the next pair needs min_frames - 1 more.
  EXPECT_GE(restarts[1] - restarts[0], static_cast<std::size_t>(options.published.min_frames - 1));
}

TEST(MatchingInitializer, InitializesBehindASceneCut) {
  const RenderedSequence& cut = rendered(small(SequenceKind::kCut, 8));
  const RenderedSequence& room = rendered(small(SequenceKind::kRoom, 16));
  std::vector<FramePtr> frames(cut.frames().begin() + 4, cut.frames().begin() + 7);  // another room
  for (int i = 0; i < room.length(); ++i) frames.push_back(room.copyAs(i, 100 + i));
  const InitRun result = run({}, room.camera(), frames);
  ASSERT_TRUE(result.result) << result.log();
  EXPECT_EQ(result.result->report.restarts, 1);
  EXPECT_EQ(result.result->report.earlier_resets,
            std::vector<InitReason>{InitReason::kTrackingLost});
  EXPECT_EQ(result.result->frames.front().frame->id().value, 100);
}

}  // namespace
}  // namespace dsorb::published
