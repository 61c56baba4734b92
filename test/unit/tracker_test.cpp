// SPDX-License-Identifier: BSD-3-Clause
#include "track/tracker.h"

#include "base/random.h"
#include "support/matchers.h"
#include "support/textured_plane.h"
#include "support/tracking_reference_of.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace dsorb::track {
namespace {

SE3 motion(double scale) {
  Vector6d xi;
  xi << 0.05, -0.03, 0.08, 0.02, -0.03, 0.02;
  return SE3::exp(scale * xi);
}

class TrackerTest : public ::testing::Test {
 protected:
  TrackerTest() : first_(plane_.render(camera_, SE3(), {FrameId{0}})) {}

  Tracker makeTracker(const TrackerOptions& options = {}, float offset = 0) {
    Tracker tracker(options);
    tracker.setReference(referenceOf(first_, camera_, plane_.samples(camera_, SE3(), 4, offset)));
    return tracker;
  }
  [[nodiscard]] FramePtr render(const SE3& T_cur_ref, const AffineBrightness& affine = {}) const {
    return plane_.render(camera_, T_cur_ref.inverse(), {FrameId{1}, 1.0}, affine);
  }

  /// Pixel by pixel: coarse levels hardly see it.
  [[nodiscard]] FramePtr withNoise(const Frame& frame, double sigma) const {
    Random random(5);
    std::vector<float> noisy;
    for (int y = 0; y < camera_.height; ++y) {
      for (int x = 0; x < camera_.width; ++x) {
        noisy.push_back(frame.level(0).at(x, y).intensity +
                        static_cast<float>(sigma * random.gaussian()));
      }
    }
    return Frame::create(ImageView(noisy.data(), camera_.width, camera_.height), {FrameId{1}, 1.0});
  }

  PinholeCamera camera_ = smallCamera();
  TexturedPlane plane_;
  FramePtr first_;
};

TEST_F(TrackerTest, UnchangedImageGivesIdentityAndNoResidual) {
  for (const float offset : {0.0F, 0.3F}) {
    Tracker tracker = makeTracker({}, offset);
    const TrackingResult result = tracker.track(*first_, {{SE3()}, {}, 100});
    ASSERT_TRUE(result.good());
    // Rounding of the projection: measured 6e-6 grey levels, and small steps that follow it by
    // 1.6e-6 deg and 7.4e-8 units; margin x4.
    EXPECT_LT(result.rmse[0], 2.5e-5);
    EXPECT_THAT(result.T_cur_ref, Se3Near(SE3(), 6.5e-6, 3e-7));
    EXPECT_EQ(result.hypotheses_tried, 1);
    EXPECT_NEAR(result.flow.full, 0, 1e-4);
  }
}

TEST_F(TrackerTest, RecoversMotionFromIdentity) {
  Tracker tracker = makeTracker();
  const SE3 truth = motion(1);
  const TrackingResult result = tracker.track(*render(truth), {{SE3()}, {}, 100});
  ASSERT_TRUE(result.good());
  // Measured 0.0123 deg and 0.00047 units; margin x2.
  EXPECT_THAT(result.T_cur_ref, Se3Near(truth, 0.025, 1e-3));
  EXPECT_GT(result.inside_fraction, 0.8);
}

TEST_F(TrackerTest, SearchesFurtherHypothesesOnlyWhenTheResidualHasGrown) {
  Tracker tracker = makeTracker();
  const SE3 truth = motion(1);
  const SE3 wrong(Eigen::Quaterniond(Eigen::AngleAxisd(0.5, Eigen::Vector3d::UnitZ())),
                  Eigen::Vector3d(0.5, 0, 0));
  const FramePtr frame = render(truth);
  const double reached = tracker.track(*frame, {{truth}, {}, 100}).rmse[0];
  const TrackingResult lenient = tracker.track(*frame, {{truth, SE3()}, {}, reached});
  EXPECT_EQ(lenient.hypotheses_tried, 1);
  const TrackingResult result = tracker.track(*frame, {{wrong, SE3(), truth}, {}, reached});
  ASSERT_TRUE(result.good());
  EXPECT_GT(result.hypotheses_tried, 1);
  EXPECT_THAT(result.T_cur_ref, Se3Near(truth, 0.025, 1e-3));
}

TEST_F(TrackerTest, SaysTooFewInsideWhenTheSceneLeavesTheImage) {
  Tracker tracker = makeTracker();
  Vector6d xi = Vector6d::Zero();
  xi[4] = 0.8;
  const SE3 turned = SE3::exp(xi);
  const TrackingResult result = tracker.track(*render(turned), {{turned}, {}, 100});
  EXPECT_EQ(result.failure, TrackingFailure::kTooFewInside) << result.inside_fraction;
  EXPECT_THAT(result.T_cur_ref, Se3Near(turned, 1e-9, 1e-9)) << "the guess is kept";
}

TEST_F(TrackerTest, AStepOfTheGainMustShowInTheGreyLevels) {
  const double gain = std::log(2);
  TrackerOptions options;
  options.max_rmse = 100;
  const TrackingStart start{{SE3()}, {}, 100, 0.3};
  EXPECT_TRUE(makeTracker(options).track(*render(SE3(), {gain, 0}), start).good());
  // Noise as strong as the texture: the grey levels spread more than the texture's gain explains.
  const FramePtr noisy = withNoise(*render(SE3(), {gain, 0}), 130);
  EXPECT_EQ(makeTracker(options).track(*noisy, start).failure, TrackingFailure::kBrightness);
}

TEST_F(TrackerTest, LargeResidualIsAFailure) {
  const FramePtr frame = withNoise(*first_, 15);
  TrackerOptions options;
  options.max_rmse = 20;
  const TrackingResult tolerated = makeTracker(options).track(*frame, {{SE3()}, {}, 100});
  ASSERT_TRUE(tolerated.good());
  EXPECT_GT(tolerated.rmse[0], 10);
  options.max_rmse = 10;
  EXPECT_EQ(makeTracker(options).track(*frame, {{SE3()}, {}, 100}).failure,
            TrackingFailure::kLargeResidual);
}

TEST_F(TrackerTest, FlowIsThePixelDisplacement) {
  Tracker tracker({});
  std::vector<DepthSample> samples = plane_.samples(camera_, SE3(), 4);
  for (DepthSample& sample : samples) sample.inverse_depth = 1;
  tracker.setReference(referenceOf(first_, camera_, samples));
  const SE3 aside(Eigen::Quaterniond::Identity(), {0.1, 0, 0});
  const FlowIndicators flow = flowIndicators(tracker.reference().at(0), camera_, aside);
  // 150 px focal length, depth 1, 0.1 units aside: 15 px. The 0.1 in the denominator takes 0.1 %.
  EXPECT_NEAR(std::sqrt(flow.translation), 15, 0.02);
  EXPECT_NEAR(flow.full, flow.translation, 1e-9);
  // Through the camera plane: left out or bounded by the image diagonal, never infinite.
  const SE3 through(Eigen::Quaterniond::Identity(), {0.0, 0, -1});
  const FlowIndicators bounded = flowIndicators(tracker.reference().at(0), camera_, through);
  EXPECT_TRUE(std::isfinite(bounded.full));
  EXPECT_LE(bounded.full, 160.0 * 160 + 128 * 128);
}

TEST_F(TrackerTest, NeedsAReference) {
  Tracker tracker({});
  EXPECT_THROW((void)tracker.track(*first_, {{SE3()}, {}, 100}), std::logic_error);
}

}  // namespace
}  // namespace dsorb::track
