// SPDX-License-Identifier: BSD-3-Clause
#include "geometry/recent_motion.h"

#include <gtest/gtest.h>

#include <cmath>

namespace dsorb::odometry {
namespace {

constexpr double kInterval = 1.0 / 30;  // [s]

/// A camera that swings about one axis and moves along another, `frequency` times a second.
Passage swinging(double time, double frequency) {
  const double w = 2 * M_PI * frequency;
  Vector6d pose;
  pose << 0, 0.1 * std::sin(w * time), 0, 0.05 * std::sin(w * time + 1), 0, 0;
  const Eigen::Vector3d spin(0.05 * w * std::cos(w * time + 1), 0, 0);
  const Eigen::Vector3d centre(0, 0.1 * std::sin(w * time), 0);
  Vector6d velocity;
  // T = [R(t) | c(t)]: from the left, the translation turns with the rotation.
  velocity << Eigen::Vector3d(0, 0.1 * w * std::cos(w * time), 0) - spin.cross(centre), spin;
  const Eigen::AngleAxisd turn(pose[3], Eigen::Vector3d::UnitX());
  return {{time, SE3(Eigen::Quaterniond(turn), centre)}, velocity};
}

RecentMotion afterFrames(int frames, double frequency, bool velocities) {
  RecentMotion motion;
  for (int i = 0; i < frames; ++i) {
    Passage passage = swinging(i * kInterval, frequency);
    if (!velocities) passage.velocity.reset();
    motion.push(passage);
  }
  return motion;
}

TEST(RecentMotion, VelocitiesOfNeighboursResolveWhatTheirPosesDoNot) {
  constexpr double kFrequency = 5;  // [Hz]; a sixth of the frames'
  const Vector6d truth = *swinging(18 * kInterval, kFrequency).velocity;
  const Vector6d parabola = afterFrames(20, kFrequency, false).inMiddle().mean.velocity;
  const Vector6d all = afterFrames(20, kFrequency, true).inMiddle().mean.velocity;
  EXPECT_GT((parabola - truth).norm(), 0.15 * truth.norm());  // measured .173
  EXPECT_LT((all - truth).norm(), 0.02 * truth.norm());
}

TEST(RecentMotion, SigmaIsWhatTheParabolaMisses) {
  double squares = 0;
  double expected = 0;
  RecentMotion motion;
  for (int i = 0; i < 200; ++i) {
    const Passage passage = swinging(i * kInterval, 2);
    motion.push({passage.pose, {}});
    if (i < 50) continue;
    const MotionPrior prior = motion.atEnd();
    squares += (prior.mean.velocity - *passage.velocity).tail<3>().squaredNorm() / 3;
    expected += prior.sigma[3] * prior.sigma[3];
  }
  EXPECT_NEAR(std::sqrt(squares / expected), 1, 0.15);
}

TEST(RecentMotion, OnlyAPoseThatIsOffTheMotionSurprises) {
  double squares = 0;
  RecentMotion motion = afterFrames(50, 2, false);
  for (int i = 50; i < 200; ++i) {
    const TimedPose next = swinging(i * kInterval, 2).pose;
    const double surprise = motion.surprise(next).value();
    squares += surprise * surprise;
    EXPECT_LT(surprise, 2.5) << i;
    const SE3 off = SE3::exp((Vector6d() << 0, 0, 0, 0, 0.1, 0).finished());
    EXPECT_GT(motion.surprise({next.time, off * next.T_cam_world}).value(), 5) << i;
    motion.push({next, {}});
  }
  EXPECT_NEAR(std::sqrt(squares / 150), 1.2, 0.3);  // of two parts the larger: measured 1.17
}

TEST(RecentMotion, AGapBeforeItSurprisesNoMore) {
  const RecentMotion motion = afterFrames(50, 1, false);
  for (int gap = 1; gap <= 4; ++gap) {
    EXPECT_LT(motion.surprise(swinging((49 + gap) * kInterval, 1).pose).value(), 2) << gap;
  }
}

TEST(RecentMotion, BeforeThereAreEnoughFramesNothingSurprises) {
  EXPECT_FALSE(afterFrames(2, 2, false).surprise(swinging(1, 2).pose));
}

TEST(RecentMotion, BeforeAnyFrameHasShownIt) {
  const Vector6d sigma = afterFrames(3, 2, false).sigma();
  EXPECT_EQ(sigma, Vector6d::Constant(0.05));
}

TEST(RecentMotion, ReferenceDoesNotMatter) {
  RecentMotion motion = afterFrames(20, 3, true);
  const MotionPrior before = motion.inMiddle();
  motion.changeReference(SE3(Eigen::Quaterniond(0.8, 0, 0.6, 0), {1, 2, 3}));
  EXPECT_LT((motion.inMiddle().mean.velocity - before.mean.velocity).norm(), 1e-9);
}

TEST(RecentMotion, FramesAtTheSameTimeAreNoNumbersToDivideBy) {
  RecentMotion motion = afterFrames(20, 3, true);
  motion.push(swinging(19 * kInterval, 3));
  EXPECT_TRUE(motion.inMiddle().mean.velocity.allFinite());
  motion.push(swinging(20 * kInterval, 3));
  EXPECT_TRUE(motion.inMiddle().mean.velocity.allFinite());
  EXPECT_TRUE(motion.sigma().allFinite());
}

}  // namespace
}  // namespace dsorb::odometry
