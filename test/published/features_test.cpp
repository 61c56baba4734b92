// SPDX-License-Identifier: BSD-3-Clause
#include "published/features.h"

#include "support/painted_frame.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace dsorb::published {
namespace {

constexpr int kMatchWidth = 320;
constexpr int kMatchHeight = 240;
const Eigen::Vector2f kShift(7.3F, -4.6F);

FramePtr paintMatches(int id, const Paint& intensity) {
  return paintFrame(id, kMatchWidth, kMatchHeight, intensity);
}

Paint shiftedScene(std::uint64_t seed) {
  return shifted(blobs(seed), kShift.x(), kShift.y());
}

TEST(MatchesByDescriptors, ReachAFractionOfAPixel) {
  Features features(2000, true);
  features.start(paintMatches(0, blobs(1)));
  ASSERT_GT(features.track(paintMatches(1, shiftedScene(1))), 100);
  EXPECT_FALSE(features.usesFlow());
  const CornerTracks tracks = features.tracks();
  std::vector<float> errors;
  for (std::size_t i = 0; i < tracks.positions[0].size(); ++i) {
    errors.push_back((tracks.positions[1][i] - tracks.positions[0][i] - kShift).norm());
  }
  std::sort(errors.begin(), errors.end());
  EXPECT_LT(errors[errors.size() / 2], 0.02F);  // measured 0.008 and 0.013; margin x2
  EXPECT_LT(errors[errors.size() * 9 / 10], 0.03F);
}

TEST(FollowedCorners, ReachAFractionOfAPixelAndEndWithTheScene) {
  Features features(500, false);
  features.start(paintMatches(0, blobs(1)));
  EXPECT_LE(features.size(), 500);
  ASSERT_GT(features.track(paintMatches(1, shiftedScene(1))), 50);
  EXPECT_FALSE(features.cut());
  const CornerTracks tracks = features.tracks();
  std::vector<float> errors;
  for (std::size_t i = 0; i < tracks.positions[0].size(); ++i) {
    errors.push_back((tracks.positions[1][i] - tracks.positions[0][i] - kShift).norm());
  }
  std::sort(errors.begin(), errors.end());
  EXPECT_LT(errors[errors.size() / 2], 0.1F);
  features.track(paintMatches(2, blobs(2)));
  EXPECT_TRUE(features.cut());
}

}  // namespace
}  // namespace dsorb::published
