// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/tracks/far_matches.h"

#include "init/orb/tracks/feature_matches.h"
#include "support/painted_frame.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

namespace dsorb::init_orb {
namespace {

constexpr int kFarWidth = 480;
constexpr int kFarHeight = 360;
const Eigen::Vector2f kFarShift(97.3F, -61.6F);  // far beyond a window of optical flow

class OrbFeatures final : public FeatureFinder {
 public:
  Features find(const GreyImage& image) override { return findFeatures(image); }
};

/// Whether descriptors are floats makes two matchers: the bits as floats, of unit length.
class FloatFeatures final : public FeatureFinder {
 public:
  Features find(const GreyImage& image) override {
    Features features = findFeatures(image);
    cv::Mat floats(features.descriptors.rows, 8 * features.descriptors.cols, CV_32F);
    for (int i = 0; i < floats.rows; ++i) {
      for (int k = 0; k < floats.cols; ++k) {
        const bool bit = (features.descriptors.at<unsigned char>(i, k / 8) >> (k % 8) & 1) != 0;
        floats.at<float>(i, k) = bit ? 1.0F / 16 : -1.0F / 16;
      }
    }
    features.descriptors = floats;
    return features;
  }
};

DescribedFrame describe(FeatureFinder& finder, int id, const Paint& scene) {
  return describeFrame(paintFrame(id, kFarWidth, kFarHeight, scene), 1, finder);
}

/// Matches a scene with itself far away.
void expectAFractionOfAPixel(FeatureFinder& finder) {
  const DescribedFrame from = describe(finder, 0, blobs(1));
  const DescribedFrame to = describe(finder, 1, shifted(blobs(1), kFarShift.x(), kFarShift.y()));
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

TEST(FarMatches, ReachAFractionOfAPixelFarAway) {
  OrbFeatures finder;
  expectAFractionOfAPixel(finder);
}

TEST(FarMatches, OfFloatDescriptorsAreAsGood) {
  FloatFeatures finder;
  expectAFractionOfAPixel(finder);
}

TEST(FarMatches, OfAnotherSceneAreFew) {
  OrbFeatures finder;
  const DescribedFrame from = describe(finder, 0, blobs(1));
  const std::vector<Eigen::Vector2f> found = findAgain(from, describe(finder, 1, blobs(2)));
  const auto seen = static_cast<double>(std::count_if(found.begin(), found.end(), isSeen));
  RecordProperty("share", std::to_string(seen / static_cast<double>(found.size())));
  EXPECT_LT(seen, 0.02 * static_cast<double>(found.size()));
}

TEST(FarMatches, OfNothingAreNone) {
  OrbFeatures finder;
  const DescribedFrame from = describe(finder, 0, blobs(1));
  const DescribedFrame nothing = describe(finder, 1, [](float, float) { return 90.0F; });
  EXPECT_TRUE(findAgain(nothing, from).empty());
  const std::vector<Eigen::Vector2f> found = findAgain(from, nothing);
  EXPECT_EQ(std::count_if(found.begin(), found.end(), isSeen), 0);
}

}  // namespace
}  // namespace dsorb::init_orb
