// SPDX-License-Identifier: BSD-3-Clause
#include "odometry/probation.h"

#include "odometry/segments.h"
#include "support/painted_frame.h"

#include <gtest/gtest.h>

#include <limits>
#include <vector>

namespace dsorb::odometry {
namespace {

FramePtr frame(int id) {
  return paintFrame(id, 64, 48, [](float /*x*/, float /*y*/) { return 100.0F; });
}

InitializationResult resultOf(int frames) {
  InitializationResult result;
  for (int i = 0; i < frames; ++i) result.frames.push_back({frame(i), SE3(), {}, {}});
  return result;
}

template <typename Frames>
std::vector<int> idsOf(const Frames& frames) {
  std::vector<int> ids;
  for (const FramePtr& f : frames) ids.push_back(f->id().value);
  return ids;
}

ProbationOptions limits() {
  ProbationOptions options;
  options.max_rms_second = 20;
  options.max_rms_third = 13;
  options.max_rms_fourth = 11;
  return options;
}

TEST(Probation, EveryKeyframeHasItsLimitUntilTheFourthEndsIt) {
  Probation probation(limits());
  probation.begin(resultOf(4));
  EXPECT_TRUE(probation.passes(20));
  EXPECT_TRUE(probation.passes(13));
  EXPECT_TRUE(probation.active());
  EXPECT_TRUE(probation.passes(11));
  EXPECT_EQ(probation.lastJudgement().keyframes, 4);
  EXPECT_FALSE(probation.active());
  EXPECT_TRUE(probation.passes(1e3)) << "nobody judges any more";
  EXPECT_TRUE(probation.end().empty()) << "the frames are not kept longer than needed";
}

TEST(Probation, FailsAboveTheLimitOfThatKeyframe) {
  const std::vector<double> allowed = {20, 13, 11};
  for (std::size_t failing = 0; failing < allowed.size(); ++failing) {
    Probation probation(limits());
    probation.begin(resultOf(4));
    for (std::size_t i = 0; i < failing; ++i) EXPECT_TRUE(probation.passes(allowed[i]));
    EXPECT_FALSE(probation.passes(allowed[failing] + 0.01)) << failing;
    EXPECT_TRUE(probation.active());
    EXPECT_EQ(probation.lastJudgement().keyframes, static_cast<int>(failing) + 2);
    EXPECT_EQ(probation.lastJudgement().rms, allowed[failing] + 0.01);
    EXPECT_EQ(probation.lastJudgement().limit, allowed[failing]);
  }
}

TEST(Probation, AResidualThatIsNoNumberFails) {
  Probation probation(limits());
  probation.begin(resultOf(4));
  EXPECT_FALSE(probation.passes(std::numeric_limits<double>::quiet_NaN()));
}

TEST(Probation, KeepsTheFramesBehindTheReference) {
  Probation probation(limits());
  probation.begin(resultOf(3));
  probation.add(frame(3));
  EXPECT_EQ(idsOf(probation.end()), (std::vector<int>{1, 2, 3}));
  EXPECT_FALSE(probation.active());
  probation.add(frame(4));
  EXPECT_FALSE(probation.active()) << "a frame does not begin a probation";
}

TEST(Probation, ForgetsTheOldestFramesBeyondTheLimit) {
  const int most = static_cast<int>(Probation::kMaxFrames);
  Probation probation(limits());
  probation.begin(resultOf(most));
  probation.add(frame(most));
  probation.add(frame(most + 1));
  const std::vector<int> ids = idsOf(probation.end());
  EXPECT_EQ(ids.size(), Probation::kMaxFrames - 1);
  EXPECT_EQ(ids.front(), 3);
  EXPECT_EQ(ids.back(), most + 1);
}

TEST(Probation, EveryBeginningIsJudgedAnew) {
  Probation probation(limits());
  for (int i = 0; i < 2; ++i) {
    probation.begin(resultOf(4));
    EXPECT_EQ(probation.lastJudgement().keyframes, 0);
    EXPECT_TRUE(probation.passes(20));
    EXPECT_FALSE(probation.passes(20));
  }
}

/// Segments with a start of frames 0 to 3 on probation.
Segments started(const ProbationOptions& options) {
  Segments segments(options);
  segments.begin(resultOf(4));
  return segments;
}

TEST(Segments, ARolledBackStartCountsForNothingAndGivesItsFramesBack) {
  Segments segments = started(limits());
  segments.countKeyframes(4);
  for (int i = 0; i < 3; ++i) EXPECT_TRUE(segments.passes(1));
  segments.countTrackedFrame();
  segments.begin(resultOf(4));
  segments.countKeyframes(4);
  segments.keepForRollback(frame(4));
  segments.countTrackedFrame();
  ASSERT_FALSE(segments.passes(21));
  ASSERT_TRUE(segments.canRollBack(RollbackReason::kResidual));
  const FailedStart failed = segments.rollBack(RollbackReason::kResidual, FrameId{5});
  EXPECT_EQ(idsOf(failed.frames), (std::vector<int>{1, 2, 3, 4}));
  EXPECT_EQ(failed.notice.frame, FrameId{5});
  EXPECT_EQ(failed.notice.segment, 0);
  EXPECT_EQ(failed.notice.reason, RollbackReason::kResidual);
  EXPECT_EQ(failed.notice.keyframes, 2);
  EXPECT_EQ(failed.notice.rms, 21);
  EXPECT_EQ(failed.notice.limit, 20);
  EXPECT_EQ(segments.counts().starts, 1) << "the first start stays";
  EXPECT_EQ(segments.counts().keyframes, 4);
  EXPECT_EQ(segments.counts().tracked_frames, 1);
}

TEST(Segments, ALossRollsBackOnceASegment) {
  Segments segments = started(limits());
  ASSERT_TRUE(segments.canRollBack(RollbackReason::kLost));
  segments.rollBack(RollbackReason::kLost, FrameId{5});
  segments.begin(resultOf(4));
  EXPECT_FALSE(segments.canRollBack(RollbackReason::kLost)) << "the second time it is a loss";
  EXPECT_TRUE(segments.canRollBack(RollbackReason::kResidual));
  segments.endProbation();
  segments.next();
  EXPECT_EQ(segments.current(), 1);
  segments.begin(resultOf(4));
  EXPECT_TRUE(segments.canRollBack(RollbackReason::kLost));
}

TEST(Segments, TheStartAfterTwoRollbacksStays) {
  Segments segments = started(limits());
  for (int start = 0; start < 2; ++start) {
    EXPECT_FALSE(segments.passes(21)) << start;
    segments.rollBack(RollbackReason::kResidual, FrameId{5});
    segments.begin(resultOf(4));
  }
  EXPECT_TRUE(segments.passes(21));
  EXPECT_TRUE(segments.passes(1e3)) << "its probation is over";
  segments.next();
  segments.begin(resultOf(4));
  EXPECT_FALSE(segments.passes(21)) << "a new segment has a budget of its own";
}

TEST(Segments, ALossIsNotForgivenWhereTheOptionsSaySo) {
  ProbationOptions options = limits();
  options.includes_loss = false;
  const Segments segments = started(options);
  EXPECT_FALSE(segments.canRollBack(RollbackReason::kLost));
  EXPECT_TRUE(segments.canRollBack(RollbackReason::kResidual));
}

TEST(Segments, NothingRollsBackAfterProbation) {
  Segments segments = started(limits());
  for (int i = 0; i < 3; ++i) EXPECT_TRUE(segments.passes(1));
  EXPECT_FALSE(segments.canRollBack(RollbackReason::kLost));
  EXPECT_FALSE(segments.canRollBack(RollbackReason::kResidual));
}

}  // namespace
}  // namespace dsorb::odometry
