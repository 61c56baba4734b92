// SPDX-License-Identifier: BSD-3-Clause
#include "odometry/frame_tracker.h"

#include "support/matchers.h"
#include "support/painted_frame.h"
#include "support/textured_plane.h"
#include "support/tracking_reference_of.h"

#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <utility>
#include <vector>

namespace dsorb::odometry {
namespace {

/// A camera that moves steadily along a plane; frames 0 to 3 are its initialization.
class FrameTrackerTest : public ::testing::Test {
 protected:
  [[nodiscard]] static SE3 T_cam_world(int i) {
    Vector6d xi;
    xi << 0.02, -0.01, 0.01, 0.002, -0.004, 0.003;
    return SE3::exp(i * xi);
  }
  [[nodiscard]] static SE3 T_cam_keyframe(int i, int keyframe) {
    return T_cam_world(i) * T_cam_world(keyframe).inverse();
  }
  [[nodiscard]] FramePtr frame(int i, double log_gain = 0) const {
    return plane_.render(camera_, T_cam_world(i).inverse(), {FrameId{i}, 0.1 * i}, {log_gain, 0});
  }
  [[nodiscard]] TrackingTarget target(int i, int previous, double log_gain = 0) const {
    return {{T_cam_world(i)},
            track::referenceOf(frame(i, log_gain),
                               camera_,
                               plane_.samples(camera_, T_cam_world(i).inverse(), 4),
                               {log_gain, 0}),
            T_cam_keyframe(i, previous)};
  }
  [[nodiscard]] FrameTracker started(double log_gain = 0) const {
    InitializationResult result;
    for (int i = 0; i < 4; ++i) result.frames.push_back({frame(i), T_cam_world(i), {}, {}});
    FrameTracker tracker(options_);
    tracker.begin(result);
    tracker.setTarget(target(3, 0, log_gain));
    return tracker;
  }
  void expectNearTruth(const TrackedPose& pose, int i, int keyframe) const {
    ASSERT_TRUE(pose.good) << "rmse " << pose.rmse.value_or(-1);
    EXPECT_EQ(pose.keyframe, FrameId{keyframe});
    // Measured at most 0.017 deg and 0.0007 units; margin x2.
    EXPECT_THAT(pose.T_cam_keyframe, Se3Near(T_cam_keyframe(i, keyframe), 0.035, 1.4e-3));
    EXPECT_THAT(pose.T_cam_world,
                Se3Near(pose.T_cam_keyframe * T_cam_world(keyframe), 1e-9, 1e-12));
  }

  PinholeCamera camera_ = smallCamera();
  TexturedPlane plane_;
  OdometryOptions options_;
};

TEST_F(FrameTrackerTest, PosesAreRelativeToTheTarget) {
  FrameTracker tracker = started();
  EXPECT_EQ(tracker.reference().frame->id(), FrameId{3});
  for (int i = 4; i < 7; ++i) expectNearTruth(tracker.track(frame(i)), i, 3);
}

TEST_F(FrameTrackerTest, GoesOnAgainstANewTarget) {
  FrameTracker tracker = started();
  for (int i = 4; i < 7; ++i) expectNearTruth(tracker.track(frame(i)), i, 3);
  tracker.setTarget(target(6, 3));
  EXPECT_EQ(tracker.reference().frame->id(), FrameId{6});
  for (int i = 7; i < 10; ++i) expectNearTruth(tracker.track(frame(i)), i, 6);
}

TEST_F(FrameTrackerTest, AFrameWhoseRotationTheMapDoesNotKnowHasNoPose) {
  for (const double sigma_deg : {0.2, 1.0}) {  // of the keyframe; the frame's is a quarter more
    FrameTracker tracker = started();
    TrackingTarget known = target(3, 0);
    const double sigma = sigma_deg * M_PI / 180;
    known.keyframe.covariance = Matrix6d::Identity();  // as free intrinsics leave it open
    known.keyframe.covariance_camera_held = sigma * sigma * Matrix6d::Identity();
    known.keyframe.reach = 1;
    tracker.setTarget(std::move(known));
    const TrackedPose pose = tracker.track(frame(4));
    EXPECT_EQ(pose.good, sigma_deg < 0.4);
    EXPECT_TRUE(pose.rmse);
  }
}

TEST_F(FrameTrackerTest, ASuspectedCameraMakesPosesAsUnsureAsTheirMotionIsLong) {
  const auto tracked = [&](double doubt) {
    FrameTracker tracker = started();
    TrackingTarget known = target(3, 0);
    known.keyframe.covariance = 1e-6 * Matrix6d::Identity();
    known.keyframe.reach = 1;
    known.keyframe.T_cam_middle = T_cam_keyframe(3, 1);
    known.keyframe.doubt = doubt;
    tracker.setTarget(std::move(known));
    return tracker.track(frame(4));
  };
  const TrackedPose sure = tracked(0);
  const TrackedPose unsure = tracked(0.3);
  ASSERT_TRUE(sure.good && unsure.good);
  EXPECT_EQ(sure.T_cam_world.matrix(), unsure.T_cam_world.matrix());
  const auto added = [](const Matrix6d& more, const Matrix6d& less) {
    const Vector6d variances = (more - less).diagonal();
    return Eigen::Vector2d(std::sqrt(variances.head<3>().sum()),
                           std::sqrt(variances.tail<3>().sum()));
  };
  const auto parts = [](const SE3& motion) {
    const Vector6d moved = motion.log();
    return Eigen::Vector2d(moved.head<3>().norm(), moved.tail<3>().norm());
  };
  const Eigen::Vector2d relative = added(*unsure.covariance, *sure.covariance);
  const Eigen::Vector2d in_window = added(*unsure.world_covariance, *sure.world_covariance);
  EXPECT_TRUE(relative.isApprox(0.3 * parts(sure.T_cam_keyframe), 1e-9));
  EXPECT_TRUE(in_window.isApprox(0.3 * parts(sure.T_cam_keyframe * T_cam_keyframe(3, 1)), 1e-9));
}

TEST_F(FrameTrackerTest, WantsAKeyframeOnceTheTargetIsFarAway) {
  FrameTracker tracker = started();
  EXPECT_FALSE(tracker.track(frame(4)).wants_keyframe);
  int first = 5;
  while (first < 20 && !tracker.track(frame(first)).wants_keyframe) ++first;
  EXPECT_EQ(first, 6) << "three steps of 1.6 pixels";
  tracker.setTarget(target(first, 3));
  EXPECT_FALSE(tracker.track(frame(first + 1)).wants_keyframe) << "near the new target";
}

TEST_F(FrameTrackerTest, AFailureSaysHowBadAndLeavesTheMotionAsItWas) {
  FrameTracker tracker = started();
  expectNearTruth(tracker.track(frame(4)), 4, 3);
  const TrackedPose failed = tracker.track(paintFrame(5, camera_.width, camera_.height, blobs(1)));
  EXPECT_FALSE(failed.good);
  EXPECT_FALSE(failed.wants_keyframe);
  expectNearTruth(tracker.track(frame(5)), 5, 3);
}

TEST_F(FrameTrackerTest, FollowsStepsOfTheBrightnessThatTheGreyLevelsShow) {
  for (const double log_gain : {-1.2, -0.7, -0.35, 0.4, 0.7, 1.1}) {
    FrameTracker tracker = started();
    const TrackedPose pose = tracker.track(frame(4, log_gain));
    expectNearTruth(pose, 4, 3);
    EXPECT_NEAR(pose.affine.a, log_gain, 0.01);
    expectNearTruth(tracker.track(frame(5)), 5, 3);
  }
}

/// Blobs on a wall that the camera passes.
class FarFrames : public ::testing::Test {
 protected:
  static constexpr float kStep = 60;  // of an image [px]
  [[nodiscard]] FramePtr frame(int i, float x) const {
    return paintFrame(i, camera_.width, camera_.height, shifted(scene_, -x, 0));
  }
  [[nodiscard]] FrameTracker started(const std::string& skip) const {
    OdometryOptions options;
    options.initializer.skip = parseSkips(skip);
    FrameTracker tracker(options);
    InitializationResult result;
    for (int i = 0; i < 3; ++i) {
      result.frames.push_back(
          {frame(i, static_cast<float>(i)), pose(static_cast<float>(i)), {}, {}});
    }
    tracker.begin(result);
    std::vector<DepthSample> wall;
    for (int y = 5; y < camera_.height - 5; y += 4) {
      for (int x = 5; x < camera_.width - 5; x += 4) {
        wall.push_back({{static_cast<float>(x), static_cast<float>(y)}, 0.5F});
      }
    }
    tracker.setTarget({{pose(2)}, track::referenceOf(frame(2, 2), camera_, wall, {}), SE3()});
    return tracker;
  }
  [[nodiscard]] SE3 pose(float x) const {
    return SE3(so3Exp({0, 0, 0}), Eigen::Vector3d(-2 * static_cast<double>(x) / camera_.fx, 0, 0));
  }

  PinholeCamera camera_{300, 300, 199.5, 149.5, 400, 300};
  Paint scene_ = blobs(1);
};

TEST_F(FarFrames, ArePosedByMatches) {
  const FramePtr far = frame(3, 2 + kStep);
  const TrackedPose posed = started("").track(far, true);
  ASSERT_TRUE(posed.good);
  EXPECT_THAT(posed.T_cam_world, Se3Near(pose(2 + kStep), 0.05, 0.002));
  const TrackedPose alone = started("matches").track(far, true);
  EXPECT_FALSE(alone.good &&
               (alone.T_cam_world.translation() - pose(2 + kStep).translation()).norm() < 0.01);
}

TEST_F(FarFrames, OfAnotherSceneHaveNone) {
  FrameTracker tracker = started("");
  EXPECT_FALSE(tracker.track(paintFrame(3, camera_.width, camera_.height, blobs(2)), true).good);
}

}  // namespace
}  // namespace dsorb::odometry
