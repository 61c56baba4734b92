// SPDX-License-Identifier: BSD-3-Clause
#include "window/keyframe_policy.h"

#include <gtest/gtest.h>

#include <cstddef>
#include <vector>

namespace dsorb::window {
namespace {

KeyframeCues quiet() {
  KeyframeCues cues;
  cues.width_plus_height = 1120;
  return cues;
}

TEST(NeedsKeyframeTest, FlowAndBrightnessEachSuffice) {
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
}

/// Keyframes on a line, 1 unit apart, all alive.
std::vector<KeyframeSummary> line(int count) {
  std::vector<KeyframeSummary> keyframes;
  for (int i = 0; i < count; ++i) {
    keyframes.push_back({i == 0, 100, 0, 0, Eigen::Vector3d(0, 0, i)});
  }
  return keyframes;
}

/// Places of the keyframes that leave.
std::vector<std::size_t> leavingOf(const std::vector<KeyframeSummary>& keyframes) {
  const std::vector<bool> flags = chooseLeaving(keyframes, {});
  EXPECT_EQ(flags.size(), keyframes.size());
  std::vector<std::size_t> leaving;
  for (std::size_t i = 0; i < flags.size(); ++i) {
    if (flags[i]) leaving.push_back(i);
  }
  return leaving;
}
using Places = std::vector<std::size_t>;

TEST(ChooseLeavingTest, NobodyLeavesAWindowWithRoom) {
  EXPECT_EQ(leavingOf(line(6)), Places{});
}

TEST(ChooseLeavingTest, FullWindowLosesExactlyOneNeitherFirstNorNewest) {
  EXPECT_EQ(leavingOf(line(7)), Places{1}) << "farthest from the newest but for the first";
}

TEST(ChooseLeavingTest, TheCrowdedKeyframeFarFromTheNewestLeaves) {
  std::vector<KeyframeSummary> keyframes = line(7);
  keyframes[3].center.z() = 2.01;  // almost where keyframe 2 is; keyframe 2 is farther away
  EXPECT_EQ(leavingOf(keyframes), Places{2}) << "evenly spread, keyframe 1 would leave";
}

TEST(ChooseLeavingTest, EmptyAndBrightnessChangedKeyframesLeaveDownToTheMinimum) {
  std::vector<KeyframeSummary> keyframes = line(7);
  keyframes[0].alive = 4;  // 4 %
  keyframes[0].gone = 96;
  keyframes[3].log_gain = 0.71;
  keyframes[4].log_gain = -0.71;
  EXPECT_EQ(leavingOf(keyframes), (Places{0, 3})) << "five must stay, so keyframe 4 does";
}

TEST(ChooseLeavingTest, ACameraThatStandsLosesTheOldest) {
  std::vector<KeyframeSummary> keyframes = line(7);
  for (KeyframeSummary& keyframe : keyframes) keyframe.center.setZero();
  EXPECT_EQ(leavingOf(keyframes), Places{1}) << "the first is protected";
}

}  // namespace
}  // namespace dsorb::window
