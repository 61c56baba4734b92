// SPDX-License-Identifier: BSD-3-Clause
// Starts from depths and rotations that the caller knows.
#include "dsorb/image/frame_priors.h"
#include "dsorb/init/metric_scale.h"

#include "support/init_run.h"
#include "support/known_depth.h"
#include "support/real_data.h"

#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

namespace dsorb {
namespace {

constexpr double kSigma = .01;                      // relative, of the depths
constexpr double kDegree = 3.14159265358979 / 180;  // [rad]

/// The frames of a rendered sequence with depths that have errors.
DepthSequence withTruth(const RenderedSequence& rendered) {
  DepthSequence sequence{
      rendered.camera(), BrightnessModel::kUncalibrated, rendered.frames(), {}, {}};
  for (int i = 0; i < rendered.length(); ++i) {
    std::vector<float> depth = rendered.inverseDepth(i);
    for (float& value : depth) value = value > 0 ? 1 / value : 0;
    sequence.depth.push_back(std::move(depth));
    sequence.T_world_cam.push_back(rendered.pose(i));
  }
  return sequence;
}

DepthSequence room() {
  synthetic::SequenceOptions options;
  options.noise_sigma = 2;
  options.width = 320;
  options.height = 240;
  options.length = 20;
  return withTruth(rendered(options));
}

InitRun feed(const DepthSequence& sequence,
             const DepthErrors& errors,
             const InitializerOptions& options = {},
             std::size_t first = 0) {
  const auto initializer = makeInitializer(options, sequence.camera);
  InitRun run;
  for (std::size_t i = first; i < sequence.frames.size() && !run.result; ++i) {
    const bool has_priors = errors.known || errors.turn_sigma > 0;
    run.steps.push_back(initializer->addFrame(has_priors ? withDepth(sequence, i, errors, kSigma)
                                                         : sequence.frames[i]));
    run.result = run.steps.back().result;
  }
  return run;
}

DepthStart judged(const InitRun& run, const DepthSequence& sequence) {
  DepthStart start;
  compare(*run.result, sequence, start);
  return start;
}

TEST(KnownDepth, StartsFromTwoFramesInMetres) {
  const DepthSequence sequence = room();
  const InitRun run = feed(sequence, {"right"});
  ASSERT_TRUE(run.result) << run.log();
  checkInvariants(*run.result);
  EXPECT_EQ(run.steps.size(), 2U) << run.log();
  const DepthStart start = judged(run, sequence);
  ASSERT_EQ(start.used, 1);
  EXPECT_LT(start.direction, 10);
  EXPECT_LT(start.depth, kSigma);
  EXPECT_LT(std::abs(start.scale), .005);
}

TEST(KnownDepth, OfAPartOfTheImageIsEnough) {
  DepthSequence sequence = room();
  const auto width = static_cast<std::size_t>(sequence.camera.width);
  for (std::vector<float>& depth : sequence.depth) {
    for (std::size_t i = 0; i < depth.size(); ++i) {
      if (i % width / 16 % 5 > 1) depth[i] = 0;
    }
  }
  const InitRun run = feed(sequence, {"right"});
  ASSERT_TRUE(run.result) << run.log();
  EXPECT_EQ(judged(run, sequence).used, 1) << run.log();
}

TEST(KnownDepth, TheUnitIsLeftOutWhereDepthsAreNotMetric) {
  const DepthSequence sequence = room();
  const auto initializer = makeInitializer({}, sequence.camera);
  for (std::size_t i = 0; i < 2; ++i) {
    const FramePtr known = withDepth(sequence, i, {"right"}, kSigma);
    FrameInfo info{FrameId{static_cast<int>(i)}, known->timestamp(), known->exposure()};
    auto priors = std::make_shared<FramePriors>(*known->priors());
    priors->depth->metric = false;
    info.priors = priors;
    std::vector<float> pixels;
    for (int y = 0; y < known->height(); ++y) {
      for (int x = 0; x < known->width(); ++x) pixels.push_back(known->level(0).at(x, y).intensity);
    }
    const InitStep step = initializer->addFrame(
        Frame::create({pixels.data(), known->width(), known->height()}, info));
    if (i == 1) {
      ASSERT_TRUE(step.result);
      EXPECT_FALSE(step.result->metric);
    }
  }
}

TEST(KnownDepth, SameBitsForAnyNumberOfThreads) {
  const DepthSequence sequence = room();
  InitializerOptions two;
  two.num_threads = 2;
  const InitRun a = feed(sequence, {"right"});
  const InitRun b = feed(sequence, {"right"}, two);
  ASSERT_TRUE(a.result && b.result);
  ASSERT_EQ(a.result->points.size(), b.result->points.size());
  for (std::size_t i = 0; i < a.result->points.size(); ++i) {
    ASSERT_EQ(a.result->points[i].inverse_depth, b.result->points[i].inverse_depth);
    ASSERT_EQ(a.result->points[i].variance, b.result->points[i].variance);
  }
  EXPECT_EQ(a.result->frames.back().T_cam_ref->matrix(),
            b.result->frames.back().T_cam_ref->matrix());
}

TEST(KnownDepth, NeverStartsACameraThatStands) {
  synthetic::SequenceOptions options;
  options.kind = synthetic::SequenceKind::kStatic;
  options.noise_sigma = 2;
  options.width = 320;
  options.height = 240;
  options.length = 20;
  const InitRun run = feed(withTruth(rendered(options)), {"right"});
  EXPECT_FALSE(run.result) << run.log();
}

/// Wrong depths: a start that is not worse than one without them.
TEST(KnownDepth, WrongOnesDoNoHarm) {
  const DepthSequence sequence = room();
  const InitRun without = feed(sequence, {"none", false});
  ASSERT_TRUE(without.result);
  const std::vector<DepthErrors> all = {
      {"small", true, std::sqrt(.1)}, {"outliers", true, 1, .05}, {"mirrored", true, 1, 0, true}};
  for (const DepthErrors& errors : all) {
    const InitRun run = feed(sequence, errors);
    ASSERT_TRUE(run.result) << errors.name << run.log();
    const DepthStart start = judged(run, sequence);
    EXPECT_LT(start.direction, 10) << errors.name;
    EXPECT_LT(start.depth, .03) << errors.name;
    EXPECT_LE(run.steps.size(), without.steps.size()) << errors.name;
    // Part of this room's mirror image is right: it is taken with deviations 3.6 times as wide.
    EXPECT_TRUE(errors.mirrored ? start.used == 0 || start.inflation > 2 : start.used == 1)
        << errors.name;
  }
}

class KnownDepthOf : public testing::TestWithParam<const char*> {};

TEST_P(KnownDepthOf, ARealSequenceStartsEarlierAndInMetres) {
  const std::string path = realData(GetParam()).string();
  if (!std::filesystem::exists(path)) GTEST_SKIP() << "no " << path;
  const DepthSequence sequence = readDepthSequence(path);
  std::size_t frames = 0;
  std::size_t frames_without = 0;
  double depth = 0;
  double depth_without = 0;
  for (const std::size_t first : {std::size_t{0}, std::size_t{30}}) {
    const InitRun run = feed(sequence, {"right"}, {}, first);
    const InitRun without = feed(sequence, {"none", false}, {}, first);
    ASSERT_TRUE(run.result) << run.log();
    ASSERT_TRUE(without.result) << without.log();
    const DepthStart start = judged(run, sequence);
    frames += run.steps.size();
    frames_without += without.steps.size();
    EXPECT_EQ(start.used, 1);
    EXPECT_LT(start.direction, 10);          // the gate's promise
    EXPECT_LT(std::abs(start.scale), .005);  // of nine starts each: .003 at most
    depth += start.depth / 2;
    depth_without += judged(without, sequence).depth / 2;
  }
  // Measured: .0098 and .0159 (hospital, where one start without comes ten frames later and is the
  // better one), .0076 and .0206.
  EXPECT_LT(depth, depth_without);
  EXPECT_LT(frames, frames_without);
}

/// Medians over starts from five frames of a sequence.
struct Starts {
  double direction = NAN;  // error [degrees]
  double frames = NAN;     // given
  int used = 0;            // of the rotations
};

Starts startsOf(const DepthSequence& sequence, const DepthErrors& errors) {
  std::vector<double> direction;
  std::vector<double> frames;
  int used = 0;
  for (std::size_t first = 0; first <= 40; first += 10) {
    const InitRun run = feed(sequence, errors, {}, first);
    EXPECT_TRUE(run.result) << errors.name << run.log();
    if (!run.result) return {};
    const DepthStart start = judged(run, sequence);
    direction.push_back(start.direction);
    frames.push_back(static_cast<double>(run.steps.size()));
    used += start.used == 1 ? 1 : 0;
  }
  return {medianOf(direction), medianOf(frames), used};
}

/// A gyroscope that errs by .2 degrees a frame knows less than the images: it takes part and
/// changes little. One that errs by ten times what it claims is refused.
TEST_P(KnownDepthOf, ARotationThatIsKnownMakesNoStartWorse) {
  const std::string path = realData(GetParam()).string();
  if (!std::filesystem::exists(path)) GTEST_SKIP() << "no " << path;
  const DepthSequence sequence = readDepthSequence(path);
  const Starts without = startsOf(sequence, {"none", false});
  DepthErrors gyroscope{"right", false};
  gyroscope.turn_sigma = .2 * kDegree;
  DepthErrors wrong = gyroscope;
  wrong.name = "claimed too small";
  wrong.turn_claimed = .1;
  for (const DepthErrors& errors : {gyroscope, wrong}) {
    const Starts with = startsOf(sequence, errors);
    // Measured: .1 % more at most.
    EXPECT_LE(with.direction, 1.05 * without.direction) << errors.name;
    EXPECT_LE(with.frames, without.frames) << errors.name;
    EXPECT_EQ(with.used, errors.turn_claimed < 1 ? 0 : 5) << errors.name;
  }
}
/// Its images are skewed by the motion of their rows, which does not speak against a gyroscope.
TEST(KnownDepth, ARotationIsTakenFromARollingShutterToo) {
  const std::string path = realData("room_rolling").string();
  if (!std::filesystem::exists(path)) GTEST_SKIP() << "no " << path;
  const DepthSequence sequence = readDepthSequence(path, Readout{.025, 0});
  DepthErrors gyroscope{"right", false};
  gyroscope.turn_sigma = 2e-4;
  const Starts with = startsOf(sequence, gyroscope);
  EXPECT_GE(with.used, 3);
}

TEST(KnownDepth, TheReadoutIsAskedForThere) {
  const std::string path = realData("room_rolling").string();
  if (!std::filesystem::exists(path)) GTEST_SKIP() << "no " << path;
  const DepthSequence sequence = readDepthSequence(path, kUnknownReadout);
  const InitRun run = feed(sequence, {"right"});
  ASSERT_TRUE(run.result) << run.log();
  ASSERT_TRUE(run.result->readout);
  EXPECT_GT(std::abs(run.result->readout->seconds), .01);
}

INSTANTIATE_TEST_SUITE_P(, KnownDepthOf, testing::Values("tartanair_hospital", "room_hand"));

}  // namespace
}  // namespace dsorb
