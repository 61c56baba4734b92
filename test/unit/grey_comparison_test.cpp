// SPDX-License-Identifier: BSD-3-Clause
#include "support/textured_plane.h"
#include "support/tracking_reference_of.h"
#include "track/tracker.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

namespace dsorb::track {
namespace {

class GreyComparisonTest : public ::testing::Test {
 protected:
  GreyComparisonTest() {
    reference_ = referenceOf(seen(SE3(), {1, 0}), camera_, plane_.samples(camera_, SE3(), 4));
  }
  /// The plane, less bright, as a sensor sees it that ends at 255.
  [[nodiscard]] FramePtr seen(const SE3& T_cur_ref, const BrightnessTransfer& transfer) const {
    const FramePtr frame = plane_.render(camera_,
                                         T_cur_ref.inverse(),
                                         {FrameId{1}, 1.0},
                                         {std::log(kDim * transfer.gain), transfer.offset});
    std::vector<float> image;
    for (int y = 0; y < camera_.height; ++y) {
      for (int x = 0; x < camera_.width; ++x) {
        image.push_back(std::clamp(frame->level(0).at(x, y).intensity, 0.0F, 255.0F));
      }
    }
    return Frame::create(ImageView(image.data(), camera_.width, camera_.height), {FrameId{1}, 1.0});
  }
  [[nodiscard]] GreyComparison compare(const FramePtr& frame, const SE3& T_cur_ref = {}) const {
    return {reference_, *frame, T_cur_ref};
  }

  static constexpr double kDim = 0.4;
  PinholeCamera camera_ = smallCamera();
  TexturedPlane plane_;
  TrackingReference reference_;
};

TEST_F(GreyComparisonTest, FindsTheGainOfAStepFromARoughPose) {
  Vector6d xi;
  xi << 0.05, -0.03, 0.08, 0.02, -0.03, 0.02;
  for (const double gain : {0.3, 0.5, 1.0, 1.5, 2.0, 3.0}) {
    const auto transfer = compare(seen(SE3::exp(xi), {gain, 5})).transfer();
    ASSERT_TRUE(transfer.has_value()) << gain;
    EXPECT_NEAR(std::log(transfer->gain), std::log(gain), 0.1) << gain;
  }
}

TEST_F(GreyComparisonTest, MisfitIsTheRelativeErrorOfTheGain) {
  const GreyComparison grey = compare(seen(SE3(), {0.8, 10}));
  EXPECT_LT(grey.misfit({0.8, 10}), 0.02);
  // Turned about the mean grey level the contrast alone is wrong.
  EXPECT_NEAR(grey.misfit({0.4, 10 + 0.4 * kDim * 128}), 0.5, 0.05);
}

TEST_F(GreyComparisonTest, AClippedImageSaysWhereItEnds) {
  EXPECT_FALSE(std::isfinite(compare(seen(SE3(), {0.5, 0})).ceiling()));
  const GreyComparison clipped = compare(seen(SE3(), {6, 0}));
  EXPECT_EQ(clipped.ceiling(), 255);
  EXPECT_LT(clipped.misfit({6, 0}), 0.02) << "what lies beyond the end is expected at it";
}

TEST_F(GreyComparisonTest, AWhiteImageSaysNothing) {
  const GreyComparison white = compare(seen(SE3(), {50, 0}));
  EXPECT_FALSE(white.transfer().has_value());
  EXPECT_FALSE(white.misfit({50, 0}) < 1);
}

}  // namespace
}  // namespace dsorb::track
