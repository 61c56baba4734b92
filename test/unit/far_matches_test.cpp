// SPDX-License-Identifier: BSD-3-Clause

#include "features/feature_matches.h"
#include "support/painted_frame.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

namespace dsorb::init_orb {
namespace {

constexpr int kFarWidth = 480;
constexpr int kFarHeight = 360;
const Eigen::Vector2f kFarShift(97.3F, -61.6F);  // far beyond a window of optical flow

DescribedFrame describe(int id, const Paint& scene) {
  return describeFrame(paintFrame(id, kFarWidth, kFarHeight, scene), 1);
}

TEST(FarMatches, ReachAFractionOfAPixelFarAway) {
  const DescribedFrame from = describe(0, blobs(1));
  const DescribedFrame to = describe(1, shifted(blobs(1), kFarShift.x(), kFarShift.y()));
  const std::vector<Eigen::Vector2f> found = findAgain(from, to);
  std::vector<float> errors;  // [px]
  for (std::size_t i = 0; i < found.size(); ++i) {
    if (isSeen(found[i])) errors.push_back((found[i] - from.positions[i] - kFarShift).norm());
  }
  std::sort(errors.begin(), errors.end());
  ASSERT_GT(errors.size(), 200U);
  EXPECT_LT(errors[errors.size() / 2], 0.02F);
  EXPECT_LT(errors[errors.size() * 95 / 100], 0.05F);
}

TEST(FarMatches, OfAnotherSceneAreFew) {
  const DescribedFrame from = describe(0, blobs(1));
  const std::vector<Eigen::Vector2f> found = findAgain(from, describe(1, blobs(2)));
  const auto seen = static_cast<double>(std::count_if(found.begin(), found.end(), isSeen));
  RecordProperty("share", std::to_string(seen / static_cast<double>(found.size())));
  EXPECT_LT(seen, 0.02 * static_cast<double>(found.size()));
}

TEST(FarMatches, OfNothingAreNone) {
  const DescribedFrame from = describe(0, blobs(1));
  const DescribedFrame nothing = describe(1, [](float, float) { return 90.0F; });
  EXPECT_TRUE(findAgain(nothing, from).empty());
  const std::vector<Eigen::Vector2f> found = findAgain(from, nothing);
  EXPECT_EQ(std::count_if(found.begin(), found.end(), isSeen), 0);
}

}  // namespace
}  // namespace dsorb::init_orb
