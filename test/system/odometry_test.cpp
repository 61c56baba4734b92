// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/odometry/odometry.h"

#include "dsorb/error.h"

#include "base/median.h"
#include "support/matchers.h"
#include "support/odometry_run.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace dsorb {
namespace {

void expectSameBits(const Recorder& a, const Recorder& b) {
  ASSERT_EQ(a.estimates.size(), b.estimates.size());
  EXPECT_EQ(a.events, b.events);
  for (std::size_t i = 0; i < a.estimates.size(); ++i) {
    const FrameEstimate& l = a.estimates[i];
    const FrameEstimate& r = b.estimates[i];
    ASSERT_EQ(l.T_world_cam.has_value(), r.T_world_cam.has_value()) << i;
    if (l.T_world_cam) {
      EXPECT_EQ(l.T_world_cam->matrix(), r.T_world_cam->matrix()) << i;
    }
    EXPECT_EQ(l.affine.a, r.affine.a) << i;
    EXPECT_EQ(l.tracking_rmse, r.tracking_rmse) << i;
    ASSERT_EQ(l.covariance.has_value(), r.covariance.has_value()) << i;
    ASSERT_EQ(l.world_covariance.has_value(), r.world_covariance.has_value()) << i;
    if (l.world_covariance) {
      EXPECT_EQ(*l.world_covariance, *r.world_covariance) << i;
    }
    if (l.covariance) {
      EXPECT_EQ(*l.covariance, *r.covariance) << i;
    }
  }
}

class OdometryWithTruth : public TruthStarted {};

/// Squared errors of the tracked poses relative to their keyframes over their variance, a degree of
/// freedom each: medians.
struct RelativeErrors {
  RelativeErrors(const World& world, const Recorder& recorder) {
    std::vector<double> moved;
    std::vector<double> turned;
    for (const FrameEstimate& estimate : recorder.estimates) {
      if (estimate.state != OdometryState::kTracked || !estimate.covariance) continue;
      const InitializationResult& start = recorder.starts.at(estimate.segment);
      const SE3 truth = world.T_cam_world(start, estimate.frame->id().value) *
                        world.T_cam_world(start, estimate.keyframe->value).inverse();
      const Vector6d error = (*estimate.T_cam_keyframe * truth.inverse()).log();
      const auto over = [&](int first) {
        const Eigen::Matrix3d variance = estimate.covariance->block<3, 3>(first, first);
        const Eigen::Vector3d e = error.segment<3>(first);
        return e.dot(variance.ldlt().solve(e)) / 3;
      };
      moved.push_back(over(0));
      turned.push_back(over(3));
    }
    frames = moved.size();
    if (frames == 0) return;
    translation = medianInPlace(moved);
    rotation = medianInPlace(turned);
  }
  std::size_t frames = 0;
  double translation = 0;
  double rotation = 0;
};

TEST_F(OdometryWithTruth, CovariancesOfTrackedPosesAreOfTheSizeOfTheirErrors) {
  start(trackedRoom());
  run(0, 30);
  const RelativeErrors errors(trackedRoom(), recorder);
  EXPECT_EQ(errors.frames, 30U - kInitialFrames);
  // Measured 1.02 and .51; a few keyframes share their errors, so the bounds are wide.
  EXPECT_LT(errors.translation, 4);
  EXPECT_LT(errors.rotation, 2);
  EXPECT_GT(errors.translation, .1);
  EXPECT_GT(errors.rotation, .05);
}

TEST_F(OdometryWithTruth, TracksARoomNearTheTruth) {
  const World& world = trackedRoom();
  start(world);
  run(0, 30);
  int tracked = 0;
  for (const FrameEstimate& estimate : recorder.estimates) {
    if (estimate.state != OdometryState::kTracked) continue;
    ++tracked;
    EXPECT_THAT(
        *estimate.T_world_cam,
        Se3Near(truePose(world, recorder, estimate), kTrackedRotationDeg, kTrackedTranslation))
        << "frame " << estimate.frame->id().value << ", rmse " << *estimate.tracking_rmse;
  }
  EXPECT_EQ(tracked, 30 - kInitialFrames);
  const OdometryReport report = odometry->finish();
  EXPECT_EQ(report.frames_given, 30);
  EXPECT_EQ(report.frames_tracked, tracked);
  EXPECT_EQ(report.segments, 1);
  EXPECT_EQ(report.keyframes, static_cast<int>(recorder.ids.size()));
}

/// Frame `i` as a sensor sees it whose exposure jumps: by factors of .3 to 4, some images clipped.
FramePtr withJumps(const FramePtr& frame, int i) {
  constexpr std::array<float, 6> kFactors = {1, 0.3F, 1.2F, 0.6F, 1.8F, 0.6F};
  const float factor = kFactors[static_cast<std::size_t>(i / 5) % kFactors.size()];
  std::vector<float> image;
  for (int y = 0; y < frame->height(); ++y) {
    for (int x = 0; x < frame->width(); ++x) {
      const float grey = factor * frame->level(0).at(x, y).intensity;
      image.push_back(std::round(std::min(grey, 255.0F)));
    }
  }
  return Frame::create(ImageView(image.data(), frame->width(), frame->height()),
                       {frame->id(), frame->timestamp()});
}

TEST_F(OdometryWithTruth, TracksThroughJumpsOfTheExposure) {
  const World& world = trackedRoom();
  start(world);
  for (int i = 0; i < 30; ++i) {
    odometry->process(withJumps(world.frames()[static_cast<std::size_t>(i)], i));
    if (i + 1 < kInitialFrames) continue;
    ASSERT_TRUE(last().T_world_cam.has_value()) << i;
    EXPECT_THAT(
        *last().T_world_cam,
        Se3Near(
            truePose(world, recorder, last()), 2 * kTrackedRotationDeg, 2 * kTrackedTranslation))
        << i;
  }
  EXPECT_EQ(odometry->finish().segments, 1);
}

TEST_F(OdometryWithTruth, TellsObserversInOrder) {
  const World& world = trackedRoom();
  start(world);
  run(0, 5);
  odometry->finish();
  const std::vector<std::string> expected = {"init 0",
                                             "initializing 0",
                                             "init 0",
                                             "initializing 0",
                                             "init 0",
                                             "initializing 0",
                                             "init 0",
                                             "keyframe 0",
                                             "keyframe 1",
                                             "keyframe 2",
                                             "keyframe 3",
                                             "initialized 0",
                                             "tracked 0",
                                             "retired 0",
                                             "retired 1",
                                             "retired 2",
                                             "retired 3"};
  EXPECT_EQ(recorder.events, expected);
  const FrameEstimate& initialized = recorder.estimates[3];
  EXPECT_TRUE(initialized.is_keyframe);
  EXPECT_EQ(initialized.keyframe, FrameId{3});
  EXPECT_THAT(
      *initialized.T_world_cam,
      Se3Near(truePose(world, recorder, initialized), kTrackedRotationDeg, kTrackedTranslation));
  const FrameEstimate& tracked = recorder.estimates[4];
  EXPECT_EQ(tracked.keyframe, FrameId{3});
  const SE3 by_keyframe = recorder.keyframes[3].T_world_cam * tracked.T_cam_keyframe->inverse();
  EXPECT_THAT(by_keyframe, Se3Near(*tracked.T_world_cam, 1e-9, 1e-9));
  EXPECT_GT(recorder.keyframes[0].points.size(), 100U);
  EXPECT_TRUE(recorder.keyframes[3].points.empty())
      << "the truth hosts all points in its reference";
}

TEST_F(OdometryWithTruth, ASceneCutLosesAndRestartBeginsANewSegment) {
  const World world(synthetic::SequenceKind::kCut, 24);
  start(world);
  run(0, 12);
  EXPECT_EQ(last().state, OdometryState::kTracked);
  run(12, 15);
  EXPECT_EQ(last().state, OdometryState::kMissed);
  run(15, 16);
  const FrameEstimate lost = last();
  EXPECT_EQ(lost.state, OdometryState::kLost) << "rmse " << lost.tracking_rmse.value_or(-1);
  EXPECT_EQ(lost.segment, 0);
  EXPECT_FALSE(lost.T_world_cam.has_value());
  EXPECT_EQ(recorder.events.back(), "lost at 15 in 0");
  EXPECT_THROW(run(16, 17), std::logic_error);

  const std::size_t before = recorder.estimates.size();
  odometry->restart();
  run(16, 24);
  const FrameEstimate& first = recorder.estimates[before];
  EXPECT_EQ(first.frame->id().value, 16);
  EXPECT_EQ(first.state, OdometryState::kInitializing);
  EXPECT_EQ(first.segment, 1) << "the new segment begins with its first frame";
  ASSERT_EQ(last().state, OdometryState::kTracked);
  EXPECT_EQ(last().segment, 1);
  EXPECT_THAT(*last().T_world_cam,
              Se3Near(truePose(world, recorder, last()), kTrackedRotationDeg, kTrackedTranslation));
  EXPECT_EQ(odometry->finish().segments, 2);
}

TEST_F(OdometryWithTruth, RestartBeforeAnyInitializationKeepsTheSegment) {
  start(trackedRoom());
  run(0, 2);
  odometry->restart();
  run(2, 6);
  EXPECT_EQ(last().state, OdometryState::kInitialized);
  EXPECT_EQ(last().segment, 0);
  EXPECT_EQ(recorder.references.front(), 2);
}

TEST(OdometryObservers, MayBeAddedInACall) {
  struct Adder : OdometryObserver {
    Odometry* odometry = nullptr;
    std::vector<std::unique_ptr<Recorder>> added;
    void onFrame(const FrameEstimate& /*estimate*/) override {
      added.push_back(std::make_unique<Recorder>());
      odometry->addObserver(added.back().get());
    }
  };
  const World& world = trackedRoom();
  Adder adder;
  Odometry odometry = world.odometry();
  adder.odometry = &odometry;
  odometry.addObserver(&adder);
  feed(odometry, world, 0, 10);
  ASSERT_EQ(adder.added.size(), 10U);
  EXPECT_EQ(adder.added.front()->estimates.size(), 9U) << "the first came with a frame";
}

TEST(OdometryRepeated, TwoObjectsInOneProcessAnswerAsAlone) {
  const World& world = trackedRoom();
  const auto alone = [&](int begin) {
    Recorder recorder;
    Odometry odometry = world.odometry();
    odometry.addObserver(&recorder);
    feed(odometry, world, begin, begin + 15);
    return recorder;
  };
  Recorder first;
  Recorder second;
  Odometry a = world.odometry();
  Odometry b = world.odometry();
  a.addObserver(&first);
  b.addObserver(&second);
  for (int i = 0; i < 15; ++i) {
    feed(a, world, i, i + 1);
    feed(b, world, i + 10, i + 11);
  }
  expectSameBits(first, alone(0));
  expectSameBits(second, alone(10));
}

TEST(OdometryRepeated, OneAndTwoThreadsGiveTheSameBits) {
  const World& world = trackedRoom();
  const auto run = [&](int threads) {
    OdometryOptions options;
    options.num_threads = threads;
    Recorder recorder;
    Odometry odometry = world.odometry(options);
    odometry.addObserver(&recorder);
    feed(odometry, world, 0, 20);
    return recorder;
  };
  expectSameBits(run(1), run(2));
}

/// Throws when it is told of a start, once.
class ThrowsAtAStart : public OdometryObserver {
 public:
  void onInitStep(const InitStep& step, const Frame& /*frame*/, int /*segment*/) override {
    if (step.result && !std::exchange(has_thrown_, true)) throw std::runtime_error("no");
  }

 private:
  bool has_thrown_ = false;
};

TEST_F(OdometryWithTruth, AnObserverThatThrowsAtAStartMakesItVoid) {
  start(trackedRoom());
  ThrowsAtAStart throws;
  odometry->addObserver(&throws);
  int thrown = 0;
  for (int i = 0; i < 12; ++i) {
    try {
      run(i, i + 1);
    } catch (const std::runtime_error&) {
      ++thrown;
    }
  }
  EXPECT_EQ(thrown, 1);
  EXPECT_EQ(last().state, OdometryState::kTracked);
}

TEST_F(OdometryWithTruth, RefusesFramesThatDoNotBelong) {
  start(trackedRoom());
  run(0, 3);
  EXPECT_THROW(odometry->process(nullptr), std::invalid_argument);
  EXPECT_THROW(run(2, 3), std::invalid_argument) << "timestamp again";
  EXPECT_THROW(run(1, 2), std::invalid_argument) << "time runs backwards";
  const std::vector<std::uint8_t> grey(64 * 48, 100);
  const FramePtr small = Frame::create(ImageView(grey.data(), 64, 48), {FrameId{3}, 1e3});
  EXPECT_THROW(odometry->process(small), std::invalid_argument) << "size";
  run(3, 5);
  EXPECT_EQ(odometry->finish().frames_tracked, 1) << "refused frames leave no trace";
  EXPECT_THROW(run(5, 6), std::logic_error) << "after finish()";
}

/// Says that it is done without a result, or the other way round.
class ConfusedInitializer : public Initializer {
 public:
  explicit ConfusedInitializer(bool has_result) : has_result_(has_result) {}
  [[nodiscard]] InitStep addFrame(FramePtr /*frame*/) override {
    InitStep step;
    step.status = has_result_ ? InitStatus::kNeedsMoreFrames : InitStatus::kInitialized;
    if (has_result_) step.result.emplace();
    return step;
  }
  void reset() override {}

 private:
  bool has_result_;
};

TEST(OdometryWithOwnInitializer, RefusesAResultThatDisagreesWithItsStatus) {
  for (const bool has_result : {false, true}) {
    Odometry odometry(
        trackedRoom().camera(), {}, std::make_unique<ConfusedInitializer>(has_result));
    EXPECT_THROW(odometry.process(trackedRoom().frames()[0]), std::logic_error);
  }
}

/// Counts refusals by their reason.
class RefusalObserver : public OdometryObserver {
 public:
  void onStartRefused(const StartRefusal& refusal) override { reasons.push_back(refusal.reason); }
  std::vector<RefusalReason> reasons;
};

TEST(OdometryWithOwnInitializer, AStartWhoseAdjustmentFailsNeverStays) {
  const World& world = trackedRoom();
  const SE3 behind(Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitY()).toRotationMatrix(),
                   Eigen::Vector3d(0, 0, 1));
  // All frames but the reference look away: no point is seen twice.
  const Truth wrong{[&](int id) { return id == 0 ? SE3() : behind; },
                    [&](int id) { return world.inverseDepth(id); }};
  OdometryOptions options;
  options.max_refusals = 0;
  Odometry odometry(
      world.camera(), options, std::make_unique<TruthInitializer>(world.camera(), wrong));
  RefusalObserver observer;
  odometry.addObserver(&observer);
  for (int i = 0; i < 5; ++i) {
    EXPECT_EQ(odometry.process(world.frames()[static_cast<std::size_t>(i)]).state,
              OdometryState::kInitializing);
  }
  EXPECT_EQ(observer.reasons, std::vector{RefusalReason::kAdjustment});
  EXPECT_EQ(odometry.finish().segments, 0);
}

TEST_F(OdometryWithTruth, RefusesOptionsOutOfRange) {
  OdometryOptions options;
  options.tracker.min_inside_fraction = 1.5;
  EXPECT_THROW((void)trackedRoom().odometry(options), ConfigError);
  EXPECT_THROW(Odometry(trackedRoom().camera(), {}, nullptr), std::invalid_argument);
  EXPECT_THROW(Odometry(PinholeCamera(), {}), std::invalid_argument);
}

TEST_F(OdometryWithTruth, ReversedSequencesTrackToo) {
  const World& world = trackedRoom();
  start(world);
  for (int i = 19; i >= 0; --i) run(i, i + 1);
  ASSERT_EQ(last().state, OdometryState::kTracked);
  EXPECT_THAT(*last().T_world_cam,
              Se3Near(truePose(world, recorder, last()), kTrackedRotationDeg, kTrackedTranslation));
}

/// Remembers which frame the initializer took as its reference.
class ReferenceObserver : public OdometryObserver {
 public:
  void onInitStep(const InitStep& step, const Frame& /*frame*/, int /*segment*/) override {
    if (step.result) reference = step.result->frames.front().frame->id().value;
  }
  int reference = -1;
};

TEST(OdometryWithOrb, InitialisesInARoomAndTracks) {
  const World& world = trackedRoom();
  Odometry odometry(world.camera(), {});
  ReferenceObserver orb;
  odometry.addObserver(&orb);
  int tracked = 0;
  for (const FramePtr& frame : world.frames()) {
    const FrameEstimate estimate = odometry.process(frame);
    ASSERT_NE(estimate.state, OdometryState::kLost) << frame->id().value;
    if (estimate.state != OdometryState::kTracked) continue;
    ++tracked;
    const SE3 truth = world.pose(orb.reference).inverse() * world.pose(estimate.frame->id().value);
    // Measured at most 0.068 deg and 1.27 deg, most of it the initializer's; margin x2.
    EXPECT_LT(rotationErrorDeg(*estimate.T_world_cam, truth), 0.14) << frame->id().value;
    EXPECT_LT(directionErrorDeg(estimate.T_world_cam->translation(), truth.translation()), 2.6)
        << frame->id().value;
  }
  EXPECT_GE(tracked, 24);  // measured 26 of 30 frames
}

}  // namespace
}  // namespace dsorb
