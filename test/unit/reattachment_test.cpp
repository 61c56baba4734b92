// SPDX-License-Identifier: BSD-3-Clause
// What reattach() and spreadCorrection() promise, step by step: nothing changes where nothing was
// corrected; the ends are the two cameras themselves; positions follow the similarity about the
// first camera that takes the second one's old position to its new one, or the correction itself.
#include "geometry/reattachment.h"

#include "geometry/turn_between.h"
#include "support/matchers.h"

#include <gtest/gtest.h>

namespace dsorb {
namespace {

SE3 pose(double tx, double ty, double tz, double rx, double ry, double rz) {
  Vector6d xi;
  xi << tx, ty, tz, rx, ry, rz;
  return SE3::exp(xi);
}

const SE3 kThen = pose(0.4, -0.1, 0.2, 0.02, 0.1, -0.05);
const SE3 kNow = pose(0.5, -0.05, 0.3, 0.03, 0.12, -0.04);
const SE3 kBetween = pose(0.2, -0.03, 0.1, 0.01, 0.04, -0.02);

TEST(TurnBetween, TurnsOneDirectionIntoTheOther) {
  const Eigen::Vector3d from(0.3, -0.2, 0.9);
  for (const Eigen::Vector3d& to :
       {Eigen::Vector3d(-0.5, 0.1, 0.4), from, Eigen::Vector3d(-2 * from)}) {
    const Eigen::Quaterniond turn = turnBetween(from, to);
    EXPECT_NEAR(turn.norm(), 1, 1e-12);
    EXPECT_NEAR((turn * from.normalized() - to.normalized()).norm(), 0, 1e-12);
  }
}

TEST(Reattach, WithoutACorrectionNothingChanges) {
  EXPECT_THAT(reattach(kBetween, {kThen, kThen}, 0.5), Se3Near(kBetween, 1e-9, 1e-12));
}

TEST(Reattach, TheEndsAreTheCamerasThemselves) {
  EXPECT_THAT(reattach(SE3(), {kThen, kNow}, 0), Se3Near(SE3(), 1e-9, 1e-12));
  EXPECT_THAT(reattach(kThen, {kThen, kNow}, 1), Se3Near(kNow, 1e-9, 1e-12));
}

TEST(Reattach, PositionsFollowTheScale) {
  SE3 longer = kThen;
  longer.setTranslation(2.5 * kThen.translation());
  const SE3 moved = reattach(kBetween, {kThen, longer}, 0.5);
  EXPECT_NEAR(
      (moved.inverse().translation() - 2.5 * kBetween.inverse().translation()).norm(), 0, 1e-12);
  EXPECT_NEAR(moved.unitQuaternion().angularDistance(kBetween.unitQuaternion()), 0, 1e-7);
}

TEST(Reattach, PositionsFollowTheDirection) {
  const Eigen::Vector3d old_way = kThen.inverse().translation();
  const Eigen::Vector3d new_way = kNow.inverse().translation();
  // A camera on the straight line to the second one stays on it, at the same share of the way.
  const SE3 on_the_line(kBetween.unitQuaternion(),
                        -(kBetween.unitQuaternion() * Eigen::Vector3d(0.3 * old_way)));
  const SE3 moved = reattach(on_the_line, {kThen, kNow}, 0.3);
  EXPECT_NEAR((moved.inverse().translation() - 0.3 * new_way).norm(), 0, 1e-12);
}

TEST(Reattach, WithoutATranslationThereIsNoScale) {
  const SE3 moved = reattach(kBetween, {SE3(), kNow}, 0.5);
  EXPECT_TRUE(moved.translation().allFinite());
  EXPECT_NEAR(moved.translation().norm(), kBetween.translation().norm(), 1e-12);
}

TEST(SpreadCorrection, WithoutACorrectionNothingChanges) {
  EXPECT_THAT(spreadCorrection(kBetween, {kThen, kThen}, 0.5), Se3Near(kBetween, 1e-9, 1e-12));
}

TEST(SpreadCorrection, TheEndsAreTheCamerasThemselves) {
  EXPECT_THAT(spreadCorrection(SE3(), {kThen, kNow}, 0), Se3Near(SE3(), 1e-9, 1e-12));
  EXPECT_THAT(spreadCorrection(kThen, {kThen, kNow}, 1), Se3Near(kNow, 1e-9, 1e-12));
}

TEST(SpreadCorrection, AWayTrackedTooShortIsStretched) {
  const SE3 half(kThen.unitQuaternion(), 0.5 * kThen.translation());
  const SE3 longer(kThen.unitQuaternion(), 1.04 * kThen.translation());
  const SE3 moved = spreadCorrection(half, {kThen, longer}, 0.5);
  const SE3 expected(kThen.unitQuaternion(), 0.52 * kThen.translation());
  EXPECT_THAT(moved, Se3Near(expected, 1e-7, 1e-12));
}

TEST(SpreadCorrection, AWayThereAndBackIsNotScaled) {
  // The second camera stands almost where the first one is: the ratio of the ways says nothing.
  const SE3 then = pose(0.001, 0, 0, 0, 0, 0);
  const SE3 now = pose(-0.001, 0, 0, 0, 0, 0);
  const SE3 moved = spreadCorrection(kBetween, {then, now}, 0.5);
  EXPECT_LE((moved.translation() - kBetween.translation()).norm(), 0.0011);
}

}  // namespace
}  // namespace dsorb
