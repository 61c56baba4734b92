// SPDX-License-Identifier: BSD-3-Clause
#include "window/keyframe_policy.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace dsorb::window {
namespace {

KeyframeCues quiet() {
  KeyframeCues cues;
  cues.rmse = 5;
  cues.first_rmse = 4;
  cues.width_plus_height = 1120;
  return cues;
}

TEST(NeedsKeyframeTest, FlowBrightnessAndErrorEachSuffice) {
  const WindowOptions options;
  EXPECT_FALSE(needsKeyframe(quiet(), options));
  KeyframeCues cues = quiet();
  cues.translation_flow = 24.9 * 24.9;  // 25 px alone are enough at 640 x 480
  EXPECT_FALSE(needsKeyframe(cues, options));
  cues.translation_flow = 25.1 * 25.1;
  EXPECT_TRUE(needsKeyframe(cues, options));
  cues = quiet();
  cues.full_flow = 50.1 * 50.1;
  EXPECT_TRUE(needsKeyframe(cues, options));
  cues = quiet();
  cues.log_gain = -0.51;
  EXPECT_TRUE(needsKeyframe(cues, options));
  cues = quiet();
  cues.rmse = 8.1;
  EXPECT_TRUE(needsKeyframe(cues, options));
}

TEST(NeedsKeyframeTest, FixedRateCountsOnlyTime) {
  WindowOptions options;
  options.keyframes_per_second = 5;
  KeyframeCues cues = quiet();
  cues.translation_flow = 1e4;
  cues.seconds_since_keyframe = 0.18;
  EXPECT_FALSE(needsKeyframe(cues, options));
  cues.seconds_since_keyframe = 0.2;
  EXPECT_TRUE(needsKeyframe(cues, options));
}

/// Keyframes on a line, 1 unit apart, all alive.
std::vector<KeyframeSummary> line(int count) {
  std::vector<KeyframeSummary> keyframes;
  for (int i = 0; i < count; ++i) {
    keyframes.push_back({i == 0, 100, 0, 0, Eigen::Vector3d(0, 0, i)});
  }
  return keyframes;
}

TEST(ChooseLeavingTest, NobodyLeavesAWindowWithRoom) {
  const std::vector<bool> leaving = chooseLeaving(line(6), {});
  EXPECT_EQ(std::count(leaving.begin(), leaving.end(), true), 0);
}

TEST(ChooseLeavingTest, FullWindowLosesExactlyOneNeitherFirstNorNewest) {
  const std::vector<bool> leaving = chooseLeaving(line(7), {});
  EXPECT_EQ(std::count(leaving.begin(), leaving.end(), true), 1);
  EXPECT_FALSE(leaving.front());
  EXPECT_FALSE(leaving.back());
}

TEST(ChooseLeavingTest, TheCrowdedKeyframeFarFromTheNewestLeaves) {
  std::vector<KeyframeSummary> keyframes = line(7);
  keyframes[2].center.z() = 1.01;  // almost where keyframe 1 is; keyframe 1 is farther away
  const std::vector<bool> leaving = chooseLeaving(keyframes, {});
  EXPECT_TRUE(leaving[1]);
}

TEST(ChooseLeavingTest, EmptyAndBrightnessChangedKeyframesLeaveDownToTheMinimum) {
  std::vector<KeyframeSummary> keyframes = line(7);
  keyframes[0].alive = 4;  // 4 %
  keyframes[0].gone = 96;
  keyframes[3].log_gain = 0.71;
  keyframes[4].log_gain = -0.71;
  const std::vector<bool> leaving = chooseLeaving(keyframes, {});
  EXPECT_TRUE(leaving[0]);
  EXPECT_TRUE(leaving[3]);
  EXPECT_FALSE(leaving[4]);  // five must stay
  EXPECT_EQ(std::count(leaving.begin(), leaving.end(), true), 2);
}

TEST(ChooseLeavingTest, ACameraThatStandsLosesTheOldest) {
  std::vector<KeyframeSummary> keyframes = line(7);
  for (KeyframeSummary& keyframe : keyframes) keyframe.center.setZero();
  const std::vector<bool> leaving = chooseLeaving(keyframes, {});
  EXPECT_TRUE(leaving[1]);
  EXPECT_EQ(std::count(leaving.begin(), leaving.end(), true), 1);
}

}  // namespace
}  // namespace dsorb::window
