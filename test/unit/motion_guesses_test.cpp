// SPDX-License-Identifier: BSD-3-Clause
#include "support/matchers.h"
#include "track/tracker.h"

#include <gtest/gtest.h>

namespace dsorb::track {
namespace {

constexpr double kRotationTolerance = 1e-9;  // [deg]
constexpr double kTolerance = 1e-12;

SE3 pose(double tx, double ty, double tz, double rx, double ry, double rz) {
  Vector6d xi;
  xi << tx, ty, tz, rx, ry, rz;
  return SE3::exp(xi);
}

MotionHistory twoFrames() {
  MotionHistory history;
  history.push({0, pose(0.1, 0, 0.3, 0.02, 0.01, 0)});
  history.push({0.1, pose(0.2, -0.1, 0.5, 0.03, 0.03, -0.01)});
  return history;
}

TEST(MotionGuesses, NamesTheFiveMotionsFirst) {
  const MotionHistory history = twoFrames();
  const std::vector<SE3> guesses = motionGuesses(history, 0.2);
  const SE3& previous = history.previous->T_cam_world;
  const SE3 motion = previous * history.before->T_cam_world.inverse();
  ASSERT_EQ(guesses.size(), 31U);
  EXPECT_THAT(guesses[0], Se3Near(motion * previous, kRotationTolerance, kTolerance));
  EXPECT_THAT(guesses[1], Se3Near(motion * motion * previous, kRotationTolerance, kTolerance));
  const SE3 half = guesses[2] * previous.inverse();
  EXPECT_THAT(half * half, Se3Near(motion, kRotationTolerance, kTolerance));
  EXPECT_THAT(guesses[3], Se3Near(previous, kRotationTolerance, kTolerance));
  EXPECT_THAT(guesses[4], Se3Near(SE3(), kRotationTolerance, kTolerance));
}

TEST(MotionGuesses, TurnsConstantMotionBySingleAxesThenTwoThenThree) {
  const std::vector<SE3> guesses = motionGuesses(twoFrames(), 0.2);
  ASSERT_EQ(guesses.size(), 31U);
  // Angle of the normalised quaternion (1, e): 2 atan |e|, as in DSO as published.
  const double single = 2 * std::atan(0.02);
  for (std::size_t i = 5; i < 31; ++i) {
    const SE3 turn = guesses[0].inverse() * guesses[i];
    const double axes = i < 11 ? 1 : i < 23 ? 2 : 3;
    EXPECT_NEAR(so3Log(turn.unitQuaternion()).norm(), 2 * std::atan(0.02 * std::sqrt(axes)), 1e-12)
        << i;
    EXPECT_LT(turn.translation().norm(), kTolerance) << i;
    for (std::size_t j = 5; j < i; ++j) {
      EXPECT_GT(rotationErrorDeg(guesses[i], guesses[j]), single / 2) << i << " equals " << j;
    }
  }
}

TEST(MotionGuesses, WithoutAnElderFrameTakesNoMotionAsConstant) {
  MotionHistory history;
  const SE3 previous = pose(0.2, 0, 0.1, 0, 0.1, 0);
  history.push({0, previous});
  const std::vector<SE3> guesses = motionGuesses(history, 0.2);
  ASSERT_EQ(guesses.size(), 28U);
  EXPECT_THAT(guesses[0], Se3Near(previous, kRotationTolerance, kTolerance));
  EXPECT_THAT(guesses[1], Se3Near(SE3(), kRotationTolerance, kTolerance));
}

TEST(MotionGuesses, ConstantIsTheVelocity) {
  const MotionHistory history = twoFrames();
  const SE3 step = history.previous->T_cam_world * history.before->T_cam_world.inverse();
  EXPECT_THAT(motionGuesses(history, 0.3)[0],
              Se3Near(step * step * history.previous->T_cam_world, kRotationTolerance, kTolerance));
}

TEST(MotionGuesses, ARepeatedFrameTellsNothingOfTheMotion) {
  const SE3 next = motionGuesses(twoFrames(), 0.3)[0];
  MotionHistory history = twoFrames();
  history.push({0.2, pose(0.001, 0, 0, 0, 0.0002, 0) * history.previous->T_cam_world});
  EXPECT_THAT(motionGuesses(history, 0.3)[0], Se3Near(next, kRotationTolerance, kTolerance));
  const SE3 still = history.previous->T_cam_world;
  history.push({0.4, still});
  EXPECT_THAT(motionGuesses(history, 0.5)[0], Se3Near(still, kRotationTolerance, kTolerance))
      << "the camera stands";
}

TEST(MotionGuesses, WithoutHistoryIsIdentityAlone) {
  const std::vector<SE3> guesses = motionGuesses({}, 0);
  ASSERT_EQ(guesses.size(), 1U);
  EXPECT_THAT(guesses[0], Se3Near(SE3(), kRotationTolerance, kTolerance));
}

}  // namespace
}  // namespace dsorb::track
