// SPDX-License-Identifier: BSD-3-Clause
#include "init/coarse/coarse_initializer.h"
#include "support/matchers.h"
#include "support/two_room_views.h"

#include <gtest/gtest.h>

#include <cmath>

namespace dsorb::init_coarse {
namespace {

/// First and fifth frame of a rendered room, the points of all levels.
class ContestTest : public testing::Test {
 protected:
  ContestTest() {
    int spacing = 5;
    for (int l = 0; l < views_.reference->pyramid().levels(); ++l) {
      const GridSelection selection = selectGridMaxima(views_.reference->level(l), 2500, spacing);
      spacing = selection.spacing;
      levels_.push_back(makePointLevel(views_.reference->level(l), selection.pixels));
      if (l > 0) findParents(levels_.back(), 2, levels_[levels_.size() - 2]);
    }
    rotation_.T_cur_ref = SE3(views_.T_cur_ref.unitQuaternion(), Eigen::Vector3d::Zero());
  }
  /// From the plane of unit depth and a motion with the true rotation.
  Estimate alignedFrom(const Eigen::Vector3d& t) {
    Estimate estimate{levels_, rotation_, {}};
    estimate.alignment.T_cur_ref.setTranslation(t);
    estimate.alignment.snapped = true;
    alignLevels({*views_.frame, views_.camera, options_, aligner_}, 0, estimate);
    return estimate;
  }
  [[nodiscard]] double directionError(const Estimate& estimate) const {
    const Eigen::Vector3d t = estimate.alignment.T_cur_ref.translation();
    return std::acos(t.normalized().dot(views_.T_cur_ref.translation().normalized())) * 180 / M_PI;
  }
  TwoRoomViews views_ = twoRoomViews();
  std::vector<PointLevel> levels_;
  Alignment rotation_;
  CoarseOptions options_;
  LevelAligner aligner_{options_};
};

TEST_F(ContestTest, FindsTheMotionFromAWrongOne) {
  const Estimate wrong = alignedFrom(-0.1 * views_.T_cur_ref.translation().normalized());
  ASSERT_GT(directionError(wrong), 20);
  const Contest result =
      contest({*views_.frame, views_.camera, options_, aligner_}, rotation_, wrong);
  EXPECT_LT(directionError(result.winner), 5) << "margin " << result.margin;
  EXPECT_GT(result.margin, 0.2);
  EXPECT_LT(result.winner.energy(), wrong.energy());
}

TEST_F(ContestTest, KeepsTheRightMotion) {
  const Estimate right = alignedFrom(0.1 * views_.T_cur_ref.translation().normalized());
  const Contest result =
      contest({*views_.frame, views_.camera, options_, aligner_}, rotation_, right);
  EXPECT_LT(directionError(result.winner), 5);
  EXPECT_LE(result.winner.energy(), right.energy());
}

TEST_F(ContestTest, PassesEndWhenTheyNoLongerHelp) {
  options_.max_passes = 20;
  const AlignmentTask task{*views_.frame, views_.camera, options_, aligner_};
  Estimate passes = alignedFrom(0.1 * views_.T_cur_ref.translation().normalized());
  Estimate converged = passes;
  converge(task, Aim{}, converged);
  double before = HUGE_VAL;
  alignLevels(task, 0, passes);
  int count = 1;
  // Each pass but the first and the last lowers the energy by more than 2 %.
  for (; count < options_.max_passes && passes.energy() != converged.energy(); ++count) {
    EXPECT_LT(passes.energy(), 0.98 * before) << "pass " << count;
    before = passes.energy();
    alignLevels(task, 0, passes);
  }
  EXPECT_EQ(passes.energy(), converged.energy());
  EXPECT_GT(converged.energy(), 0.98 * before);
  EXPECT_LT(count, options_.max_passes);
}

TEST_F(ContestTest, OnePassIsEnoughForWhatCannotReachItsAim) {
  const AlignmentTask task{*views_.frame, views_.camera, options_, aligner_};
  const Estimate start = alignedFrom(-0.1 * views_.T_cur_ref.translation().normalized());
  Estimate once = start;
  alignLevels(task, 0, once);
  Estimate all = start;
  converge(task, Aim{}, all);
  ASSERT_LT(all.energy(), once.energy());
  Estimate hopeless = start;
  converge(task, Aim{1, 0.1 * all.energy()}, hopeless);
  EXPECT_EQ(hopeless.energy(), once.energy());
  Estimate hopeful = start;
  converge(task, Aim{1, all.energy()}, hopeful);
  EXPECT_EQ(hopeful.energy(), all.energy());
}

}  // namespace
}  // namespace dsorb::init_coarse
