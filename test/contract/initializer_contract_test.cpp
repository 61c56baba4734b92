// SPDX-License-Identifier: BSD-3-Clause
// The contract of Initializer, clause by clause, for every variant the command line knows.
#include "dsorb/error.h"
#include "dsorb/init/initializer.h"

#include "support/init_run.h"
#include "support/matchers.h"
#include "support/published_variants.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <vector>

namespace dsorb {
namespace {

using synthetic::SequenceKind;

synthetic::SequenceOptions optionsOf(SequenceKind kind) {
  synthetic::SequenceOptions options;
  options.kind = kind;
  options.length = 16;
  return options;
}

/// Where accuracy is not the question: a quarter of the pixels.
synthetic::SequenceOptions smallOptionsOf(SequenceKind kind) {
  synthetic::SequenceOptions options = optionsOf(kind);
  options.width = 320;
  options.height = 240;
  return options;
}

class InitializerContract : public testing::TestWithParam<std::string> {
 protected:
  static std::unique_ptr<Initializer> make(const PinholeCamera& camera, int num_threads = 1) {
    InitializerOptions options = initializerVariant(GetParam());
    options.num_threads = num_threads;
    return makeInitializer(options, camera);
  }
  static InitRun run(const RenderedSequence& sequence) {
    const auto initializer = make(sequence.camera());
    return feed(*initializer, sequence.frames());
  }
};

FramePtr filled(const PinholeCamera& camera, int id, float intensity) {
  const std::vector<float> pixels(
      static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height), intensity);
  return Frame::create({pixels.data(), camera.width, camera.height},
                       {FrameId{id}, 0.1 * id, 1, nullptr});
}

void expectAccurate(const InitRun& run, const RenderedSequence& sequence) {
  ASSERT_TRUE(run.result) << run.log();
  const StartErrors errors = startErrors(*run.result, sequence);
  EXPECT_LT(errors.rotation_deg, 0.2) << run.log();
  EXPECT_LT(errors.direction_deg, 2.0) << run.log();
  EXPECT_LT(errors.median_relative_depth, 0.03) << run.log();
}

TEST_P(InitializerContract, IsAccurateInARoomWithoutNoise) {
  const RenderedSequence& sequence = rendered(optionsOf(SequenceKind::kRoom));
  expectAccurate(run(sequence), sequence);
}

TEST_P(InitializerContract, IsAccurateInAStreetWithoutNoise) {
  const RenderedSequence& sequence = rendered(optionsOf(SequenceKind::kStreet));
  expectAccurate(run(sequence), sequence);
}

TEST_P(InitializerContract, IsAccurateUnderExposureChanges) {
  synthetic::SequenceOptions options = optionsOf(SequenceKind::kRoom);
  options.exposure_changes = 0.3;
  const RenderedSequence& sequence = rendered(options);
  expectAccurate(run(sequence), sequence);
}

TEST_P(InitializerContract, VariancesAreThoseOfTheErrors) {
  std::vector<double> nees;  // of three rooms: one start alone tells it to a factor of two only
  for (const std::uint64_t seed : {1U, 2U, 3U}) {
    synthetic::SequenceOptions options = optionsOf(SequenceKind::kRoom);
    options.noise_sigma = 2;
    options.seed = seed;
    const RenderedSequence& sequence = rendered(options);
    const InitRun result = run(sequence);
    ASSERT_TRUE(result.result) << result.log();
    nees.push_back(startErrors(*result.result, sequence).median_squared_error_over_variance);
    RecordProperty("nees" + std::to_string(seed), std::to_string(nees.back()));
  }
  std::sort(nees.begin(), nees.end());
  // Medians measured: coarse .096 (of .083, .096, .138: its variances are too wide in rooms), the
  // others .29 to .46.
  EXPECT_GT(nees[1], GetParam() == "coarse" ? 0.06 : 0.15);
  EXPECT_LT(nees[1], 2.0);
}

TEST(InitializersOnAPlane, TwoStartAndAllStartsAreRight) {
  const RenderedSequence& sequence = rendered(optionsOf(SequenceKind::kPlane));
  int starts = 0;
  for (const std::string& variant : initializerVariants()) {
    const auto initializer = makeInitializer(initializerVariant(variant), sequence.camera());
    const InitRun result = feed(*initializer, sequence.frames());
    if (!result.result) continue;
    ++starts;
    const StartErrors errors = startErrors(*result.result, sequence);
    EXPECT_LT(errors.rotation_deg, 1.0) << variant << ": " << result.log();
    EXPECT_LT(errors.direction_deg, 5.0) << variant << ": " << result.log();
  }
  EXPECT_EQ(starts, 2);  // coarse and orb; the published variants refuse it as degenerate
}

TEST_P(InitializerContract, HandsOverEveryFrameSinceTheReference) {
  const RenderedSequence& sequence = rendered(optionsOf(SequenceKind::kRoom));
  const InitRun result = run(sequence);
  ASSERT_TRUE(result.result) << result.log();
  const std::vector<PosedFrame>& frames = result.result->frames;
  EXPECT_NO_THROW(checkInvariants(*result.result));
  EXPECT_EQ(frames.back().frame, sequence.frames()[result.steps.size() - 1]);
  for (std::size_t i = 1; i < frames.size(); ++i) {
    EXPECT_EQ(frames[i].frame->id().value, frames[i - 1].frame->id().value + 1);
    EXPECT_TRUE(frames[i].T_cam_ref) << "frame " << i;
    EXPECT_EQ(frames[i].covariance.has_value(), frames.back().covariance.has_value())
        << "frame " << i;
  }
  EXPECT_EQ(result.steps.back().reason, InitReason::kDone);
  EXPECT_FALSE(result.result->report.stages.empty());
  EXPECT_FALSE(result.result->report.model.empty());
}

TEST_P(InitializerContract, AnswersNeedsMoreFramesUntilTheResult) {
  const InitRun result = run(rendered(optionsOf(SequenceKind::kRoom)));
  ASSERT_TRUE(result.result) << result.log();
  EXPECT_EQ(result.steps.front().reason, InitReason::kFirstFrame);
  for (std::size_t i = 0; i + 1 < result.steps.size(); ++i) {
    EXPECT_EQ(result.steps[i].status, InitStatus::kNeedsMoreFrames) << result.log();
    EXPECT_FALSE(result.steps[i].result);
  }
  EXPECT_EQ(result.steps.back().status, InitStatus::kInitialized);
}

TEST_P(InitializerContract, WaitsWhileTheCameraStandsAndDropsTheOldestFrames) {
  synthetic::SequenceOptions options = smallOptionsOf(SequenceKind::kStatic);
  options.noise_sigma = 2;
  const RenderedSequence& sequence = rendered(options);
  const auto initializer = make(sequence.camera());
  std::vector<std::weak_ptr<const Frame>> given;
  constexpr int kRepetitions = 6;  // of a short sequence
  for (int i = 0; i < kRepetitions * sequence.length(); ++i) {
    const FramePtr copy = sequence.copyAs(i % sequence.length(), i);
    given.push_back(copy);
    const InitStep step = initializer->addFrame(copy);
    EXPECT_EQ(step.status, InitStatus::kNeedsMoreFrames)
        << "frame " << i << " " << name(step.reason);
  }
  const auto alive =
      std::count_if(given.begin(), given.end(), [](const auto& frame) { return !frame.expired(); });
  EXPECT_LE(alive, 40);  // of 96 given; `orb-v1` keeps 20
}

TEST_P(InitializerContract, WaitsWhileTheCameraOnlyRotates) {
  synthetic::SequenceOptions options = smallOptionsOf(SequenceKind::kRotation);
  options.noise_sigma = 2;
  options.length = 45;
  const InitRun result = run(rendered(options));
  EXPECT_FALSE(result.result) << result.log();
  for (const InitStep& step : result.steps) {
    EXPECT_EQ(step.status, InitStatus::kNeedsMoreFrames) << result.log();
  }
}

TEST_P(InitializerContract, WaitsWhileTheCameraTurnsAwayFromTheReference) {
  synthetic::SequenceOptions options = smallOptionsOf(SequenceKind::kRotation);
  options.fx = 1200;  // 15 degrees of view: the reference leaves it within 12 frames
  options.length = 40;
  const InitRun result = run(rendered(options));
  for (const InitStep& step : result.steps) {
    EXPECT_EQ(step.status, InitStatus::kNeedsMoreFrames) << result.log();
  }
}

TEST_P(InitializerContract, RestartsAfterSceneCut) {
  synthetic::SequenceOptions options = optionsOf(SequenceKind::kCut);
  options.length = 4;  // the cut, with the third frame, comes before the first attempt
  const RenderedSequence& sequence = rendered(options);
  const InitRun result = run(sequence);
  ASSERT_GT(result.steps.size(), 2U) << result.log();
  EXPECT_EQ(result.steps[2].status, InitStatus::kRestarted) << result.log();
  EXPECT_FALSE(result.result) << result.log();
}

TEST_P(InitializerContract, SurvivesDarkFramesAndStartsAfterThem) {
  const RenderedSequence& sequence = rendered(optionsOf(SequenceKind::kRoom));
  const auto initializer = make(sequence.camera());
  for (int i = 0; i < 10; ++i) {
    EXPECT_FALSE(initializer->addFrame(filled(sequence.camera(), i - 100, 0)).result);
  }
  const InitRun result = feed(*initializer, sequence.frames());
  expectAccurate(result, sequence);
}

TEST_P(InitializerContract, SurvivesFramesWithoutAnyInformation) {
  const PinholeCamera& camera = rendered(optionsOf(SequenceKind::kRoom)).camera();
  const float nan = std::numeric_limits<float>::quiet_NaN();
  for (const float intensity : {0.0F, 255.0F, nan}) {
    const auto initializer = make(camera);
    for (int i = 0; i < 30; ++i) {
      EXPECT_FALSE(initializer->addFrame(filled(camera, i, intensity)).result);
    }
  }
}

TEST(HurriedInitializer, OnlyFollowsUntilThereIsTime) {
  const RenderedSequence& sequence = rendered(optionsOf(SequenceKind::kRoom));
  const auto hurried = makeInitializer({}, sequence.camera());
  hurried->setHurried(true);
  std::size_t i = 0;
  for (; i < 8; ++i) {  // without haste it starts with the third frame
    const InitStep step = hurried->addFrame(sequence.frames()[i]);
    EXPECT_EQ(step.status, InitStatus::kNeedsMoreFrames);
    EXPECT_EQ(step.reason, i == 0 ? InitReason::kFirstFrame : InitReason::kHurried);
  }
  hurried->setHurried(false);
  const InitStep step = hurried->addFrame(sequence.frames()[i]);
  ASSERT_TRUE(step.result) << name(step.reason);
  EXPECT_LT(startErrors(*step.result, sequence).direction_deg, 2);
}

TEST(HurriedInitializer, StartsInTheEndThoughThereIsNeverTime) {
  const RenderedSequence& sequence = rendered(optionsOf(SequenceKind::kRoom));
  const auto hurried = makeInitializer({}, sequence.camera());
  hurried->setHurried(true);
  const InitRun run = feed(*hurried, sequence.frames());
  ASSERT_TRUE(run.result);
  EXPECT_LT(startErrors(*run.result, sequence).direction_deg, 2);
}

TEST_P(InitializerContract, ResetEqualsAFreshObject) {
  const RenderedSequence& sequence = rendered(optionsOf(SequenceKind::kRoom));
  const auto initializer = make(sequence.camera());
  const InitRun first = feed(*initializer, sequence.frames());
  initializer->reset();
  const InitRun second = feed(*initializer, sequence.frames());
  ASSERT_TRUE(first.result && second.result);
  EXPECT_TRUE(sameBits(*first.result, *second.result));
  EXPECT_EQ(second.result->report.restarts, 0);
}

TEST_P(InitializerContract, SameBitsForAnyNumberOfThreads) {
  synthetic::SequenceOptions options = optionsOf(SequenceKind::kRoom);
  options.noise_sigma = 2;
  const RenderedSequence& sequence = rendered(options);
  const InitRun one = feed(*make(sequence.camera(), 1), sequence.frames());
  const InitRun four = feed(*make(sequence.camera(), 4), sequence.frames());
  ASSERT_TRUE(one.result && four.result);
  EXPECT_EQ(one.steps.size(), four.steps.size());
  EXPECT_TRUE(sameBits(*one.result, *four.result));
}

TEST_P(InitializerContract, WorksBackwardsInTime) {
  const RenderedSequence& sequence = rendered(optionsOf(SequenceKind::kRoom));
  std::vector<FramePtr> reversed(sequence.frames().rbegin(), sequence.frames().rend());
  const InitRun result = feed(*make(sequence.camera()), reversed);
  expectAccurate(result, sequence);
}

TEST_P(InitializerContract, RefusesMisuse) {
  const RenderedSequence& sequence = rendered(optionsOf(SequenceKind::kRoom));
  const auto initializer = make(sequence.camera());
  EXPECT_THROW((void)initializer->addFrame(nullptr), std::invalid_argument);
  EXPECT_THROW((void)initializer->addFrame(filled({1, 1, 0, 0, 64, 48}, 0, 9)),
               std::invalid_argument);
  (void)initializer->addFrame(sequence.frames()[1]);
  EXPECT_THROW((void)initializer->addFrame(sequence.frames()[1]), std::invalid_argument);
  (void)initializer->addFrame(sequence.frames()[2]);
  EXPECT_THROW((void)initializer->addFrame(sequence.frames()[0]), std::invalid_argument);
  initializer->reset();
  ASSERT_TRUE(feed(*initializer, sequence.frames()).result);
  EXPECT_THROW((void)initializer->addFrame(sequence.frames().back()), std::logic_error);
}

TEST(MakeInitializer, RefusesOptionsOutOfRangeAndUnknownVariants) {
  const PinholeCamera camera{400, 400, 319.5, 239.5, 640, 480};
  InitializerOptions options;
  options.orb.min_frames = 0;
  EXPECT_THROW((void)makeInitializer(options, camera), ConfigError);
  EXPECT_THROW((void)makeInitializer({}, PinholeCamera()), std::invalid_argument);
  EXPECT_THROW((void)initializerVariant("orb-v9"), ConfigError);
}

std::string testName(const testing::TestParamInfo<std::string>& info) {
  std::string text = info.param;
  std::replace(text.begin(), text.end(), '-', '_');
  return text;
}

INSTANTIATE_TEST_SUITE_P(EveryVariant,
                         InitializerContract,
                         testing::ValuesIn(initializerVariants()),
                         testName);

}  // namespace
}  // namespace dsorb
