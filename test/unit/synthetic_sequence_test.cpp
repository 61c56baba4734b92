// SPDX-License-Identifier: BSD-3-Clause
#include "base/parallel.h"
#include "synthetic/places.h"
#include "synthetic/sequence.h"

#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>
#include <vector>

namespace dsorb::synthetic {
namespace {

SequenceOptions small(SequenceKind kind) {
  SequenceOptions options;
  options.kind = kind;
  options.width = 160;
  options.height = 120;
  options.length = 20;
  return options;
}

constexpr SequenceKind kAllKinds[] = {SequenceKind::kStreet,
                                      SequenceKind::kRoom,
                                      SequenceKind::kPlane,
                                      SequenceKind::kStatic,
                                      SequenceKind::kRotation,
                                      SequenceKind::kCut,
                                      SequenceKind::kBlock,
                                      SequenceKind::kRound};

/// Mean and standard deviation of the difference of two images.
struct Difference {
  double mean = 0;
  double sigma = 0;
};

Difference difference(const SyntheticFrame& a, const SyntheticFrame& b) {
  double sum = 0;
  double squares = 0;
  for (std::size_t i = 0; i < a.image.size(); ++i) {
    const double d = a.image[i] - b.image[i];
    sum += d;
    squares += d * d;
  }
  const auto n = static_cast<double>(a.image.size());
  return {sum / n, std::sqrt(squares / n - sum * sum / (n * n))};
}

/// Smallest and largest distance between neighbouring camera centres [m].
struct Steps {
  double least = 1e9;
  double most = 0;
};

Steps steps(const SyntheticSequence& sequence) {
  Steps found;
  for (int i = 1; i < sequence.length(); ++i) {
    const double step =
        (sequence.pose(i).translation() - sequence.pose(i - 1).translation()).norm();
    found.least = std::min(found.least, step);
    found.most = std::max(found.most, step);
  }
  return found;
}

TEST(SyntheticSequence, GivesTheSameFrameWheneverAsked) {
  for (const SequenceKind kind : kAllKinds) {
    SequenceOptions options = small(kind);
    options.noise_sigma = 2;
    options.moving_object = true;
    const SyntheticSequence sequence(options);
    const SyntheticFrame first = TaskArena(1).run([&] { return sequence.frame(7); });
    (void)sequence.frame(3);
    const SyntheticFrame again =
        TaskArena(4).run([&] { return SyntheticSequence(options).frame(7); });
    EXPECT_EQ(first.image, again.image);
    EXPECT_EQ(first.inverse_depth, again.inverse_depth);
    EXPECT_EQ(first.T_world_cam.matrix(), sequence.pose(7).matrix());
  }
}

TEST(SyntheticSequence, SeedChangesPlaceAndPath) {
  SequenceOptions options = small(SequenceKind::kRoom);
  const SyntheticFrame one = SyntheticSequence(options).frame(0);
  options.seed = 2;
  const SyntheticFrame two = SyntheticSequence(options).frame(0);
  EXPECT_GT(difference(one, two).sigma, 10);
  EXPECT_GT((one.T_world_cam.translation() - two.T_world_cam.translation()).norm(), 0.01);
}

TEST(SyntheticSequence, DrivesAndFliesAtThePromisedSpeed) {
  SequenceOptions options = small(SequenceKind::kStreet);
  options.length = 300;
  for (const std::uint64_t seed : {1U, 2U, 3U}) {
    options.seed = seed;
    options.kind = SequenceKind::kStreet;
    const SyntheticSequence street(options);
    EXPECT_GE(steps(street).least, 1.0);
    EXPECT_LE(steps(street).most, 1.3);
    EXPECT_DOUBLE_EQ(street.timestamp(10), 1.0);
    EXPECT_NEAR(street.camera().fx / street.camera().width, 0.58, 1e-12);
    options.kind = SequenceKind::kRoom;
    const SyntheticSequence room(options);
    EXPECT_GE(steps(room).least, 0.015);
    EXPECT_LE(steps(room).most, 0.03);
  }
}

TEST(SyntheticSequence, TheStreetRoundTheBlockEndsWhereItBegan) {
  for (double along = -1; along < 2 * kBlockLength; along += 0.5) {
    const StreetAxis here = blockAxis(along);
    const StreetAxis next = blockAxis(along + 0.5);
    EXPECT_NEAR(std::hypot(next.x - here.x, next.z - here.z), 0.5, 1e-4);
    const double course = std::atan2(next.x - here.x, next.z - here.z);
    EXPECT_NEAR(std::remainder(course - 0.5 * (here.heading + next.heading), 2 * M_PI), 0, 0.01);
    const StreetAxis again = blockAxis(along + kBlockLength);
    EXPECT_NEAR(std::hypot(again.x - here.x, again.z - here.z), 0, 1e-9);
  }
}

TEST(SyntheticSequence, StaticFramesDifferByNoiseAlone) {
  SequenceOptions options = small(SequenceKind::kStatic);
  const SyntheticSequence clean(options);
  EXPECT_EQ(clean.frame(0).image, clean.frame(9).image);
  options.noise_sigma = 2;
  const SyntheticSequence noisy(options);
  const Difference found = difference(noisy.frame(0), noisy.frame(9));
  // Two independent noises and two roundings: sqrt(2 * (4 + 1 / 12)) = 2.86, of 19200 pixels.
  EXPECT_NEAR(found.sigma, 2.86, 0.06);
  EXPECT_NEAR(found.mean, 0, 0.06);
  EXPECT_FALSE(noisy.hasParallax());
}

TEST(SyntheticSequence, RotationHasNoTranslation) {
  const SyntheticSequence sequence(small(SequenceKind::kRotation));
  EXPECT_EQ(steps(sequence).most, 0);
  const SE3 T = sequence.pose(0).inverse() * sequence.pose(10);
  EXPECT_GT(so3Log(T.unitQuaternion()).norm(), 0.1);
  EXPECT_FALSE(sequence.hasParallax());
}

TEST(SyntheticSequence, CutChangesThePlaceInTheMiddle) {
  const SyntheticSequence sequence(small(SequenceKind::kCut));
  const double before = difference(sequence.frame(8), sequence.frame(9)).sigma;
  const double across = difference(sequence.frame(9), sequence.frame(10)).sigma;
  const double after = difference(sequence.frame(10), sequence.frame(11)).sigma;
  EXPECT_GT(across, 2 * std::max(before, after)) << before << ' ' << across << ' ' << after;
  EXPECT_GT((sequence.pose(10).translation() - sequence.pose(9).translation()).norm(), 50);
}

TEST(SyntheticSequence, ObjectMovesAndNothingElseDoes) {
  SequenceOptions options = small(SequenceKind::kStatic);
  options.moving_object = true;
  const SyntheticSequence sequence(options);
  SyntheticFrame one;
  SyntheticFrame other;
  for (int i = 0; i + 5 < sequence.length() && !one.moving_object_visible; ++i) {
    one = sequence.frame(i);
    other = sequence.frame(i + 5);
  }
  ASSERT_TRUE(one.moving_object_visible);
  options.moving_object = false;
  const SyntheticFrame empty = SyntheticSequence(options).frame(0);
  int moved = 0;
  for (std::size_t i = 0; i < one.image.size(); ++i) {
    const bool covered = one.inverse_depth[i] != empty.inverse_depth[i];
    moved += static_cast<int>(one.inverse_depth[i] != other.inverse_depth[i]);
    EXPECT_TRUE(!covered || one.inverse_depth[i] > empty.inverse_depth[i]);
  }
  EXPECT_GT(moved, 20);
  EXPECT_LT(moved, static_cast<int>(one.image.size()) / 4);
}

TEST(SyntheticSequence, CarAheadIsSeenInTheStreet) {
  SequenceOptions options = small(SequenceKind::kStreet);
  options.moving_object = true;
  const SyntheticSequence sequence(options);
  EXPECT_TRUE(sequence.frame(0).moving_object_visible);
  EXPECT_TRUE(sequence.frame(19).moving_object_visible);
}

TEST(SyntheticSequence, VanAheadCoversItsShareOfTheStreet) {
  SequenceOptions options = small(SequenceKind::kStreet);
  const std::vector<float> empty = SyntheticSequence(options).inverseDepth(0);
  options.moving_object = true;
  options.moving_object_share = 0.1;
  const std::vector<float> van = SyntheticSequence(options).inverseDepth(0);
  int covered = 0;
  for (std::size_t i = 0; i < van.size(); ++i) covered += van[i] != empty[i] ? 1 : 0;
  EXPECT_NEAR(covered / static_cast<double>(van.size()), 0.1, 0.015);
}

TEST(SyntheticSequence, BlurSoftensTheImageAndKeepsTheDepth) {
  SequenceOptions options = small(SequenceKind::kRotation);
  const SyntheticFrame sharp = SyntheticSequence(options).frame(4);
  options.motion_blur = 1;
  const SyntheticFrame blurred = SyntheticSequence(options).frame(4);
  const auto roughness = [](const SyntheticFrame& frame) {
    double sum = 0;
    for (std::size_t i = 1; i < frame.image.size(); ++i) {
      sum += std::abs(frame.image[i] - frame.image[i - 1]);
    }
    return sum;
  };
  // 2 px of motion; measured 0.84.
  EXPECT_LT(roughness(blurred), 0.9 * roughness(sharp));
  EXPECT_EQ(blurred.inverse_depth, sharp.inverse_depth);
}

/// Mean difference of the grey levels in some rows of two frames.
double rowDifference(const SyntheticFrame& a, const SyntheticFrame& b, int first, int last) {
  double sum = 0;
  for (int i = first * a.width; i < (last + 1) * a.width; ++i) {
    const auto pixel = static_cast<std::size_t>(i);
    sum += std::abs(a.image[pixel] - b.image[pixel]);
  }
  return sum / ((last + 1 - first) * a.width);
}

TEST(SyntheticSequence, RollingShutterShowsEachRowAtItsOwnTime) {
  for (const SequenceKind kind : {SequenceKind::kStreet, SequenceKind::kRoom}) {
    SequenceOptions options = small(kind);
    options.height = 121;
    options.moving_object = true;
    const SyntheticSequence still(options);
    options.readout = kind == SequenceKind::kStreet ? 0.1 : 1.0 / 30;  // a whole frame
    const SyntheticSequence downwards(options);
    options.readout = -options.readout;
    const SyntheticSequence upwards(options);
    const SyntheticFrame rolled = downwards.frame(7);
    EXPECT_EQ(rowDifference(rolled, still.frame(7), 60, 60), 0);
    EXPECT_EQ(rowDifference(upwards.frame(7), still.frame(7), 60, 60), 0);
    // Measured 1.39 grey levels in the room, more in the street.
    EXPECT_GT(rowDifference(rolled, still.frame(7), 0, 20), 0.7);
    EXPECT_EQ(rolled.inverse_depth, still.frame(7).inverse_depth);
    // The last row of one frame and the first of the next are half way between the two.
    EXPECT_EQ(rowDifference(downwards.frame(8), upwards.frame(7), 0, 0), 0);
    EXPECT_EQ(rowDifference(downwards.frame(7), upwards.frame(8), 120, 120), 0);
  }
}

TEST(SyntheticSequence, SpeedScalesTheMotion) {
  SequenceOptions options = small(SequenceKind::kRoom);
  const SyntheticSequence usual(options);
  options.speed = 0.5;
  const SyntheticSequence slow(options);
  EXPECT_EQ(slow.pose(8).matrix(), usual.pose(4).matrix());
  EXPECT_EQ(slow.frame(8).image, usual.frame(4).image);
  EXPECT_EQ(slow.timestamp(8), usual.timestamp(8));
}

TEST(SyntheticSequence, CorrectionUndoesTheCamera) {
  SequenceOptions options = small(SequenceKind::kStatic);
  const FramePtr plain = SyntheticSequence(options).framePtr(0);
  options.nonlinear_response = true;
  options.vignette = true;
  options.exposure_changes = 0.3;
  const SyntheticSequence sequence(options);
  for (const int index : {0, 9}) {
    const FramePtr corrected = sequence.framePtr(index);
    const double gain = corrected->exposure() / (0.01 * std::exp(0.3));
    double worst = 0;
    for (int i = 0; i < 160 * 120; ++i) {
      const float value = corrected->level(0).data()[i];
      worst = std::max(worst, std::abs(value / gain - plain->level(0).data()[i]));
    }
    // Half a grey level of rounding, times the largest slope of the inverse response (1.65), over
    // the darkest vignette (0.6) and the smallest gain (0.55), and half a level of the plain image.
    EXPECT_LT(worst, 0.5 * 1.65 / (0.6 * gain) + 0.5 + 0.05) << "frame " << index;
  }
  EXPECT_GT(sequence.exposure(9), 1.2 * sequence.exposure(0));
}

TEST(SyntheticSequence, RefusesOptionsOutOfRange) {
  SequenceOptions options = small(SequenceKind::kRoom);
  options.noise_sigma = -1;
  EXPECT_THROW(SyntheticSequence{options}, std::invalid_argument);
  options = small(SequenceKind::kRoom);
  options.readout = 0.034;
  EXPECT_THROW(SyntheticSequence{options}, std::invalid_argument);
  options = small(SequenceKind::kRoom);
  options.width = 8;
  EXPECT_THROW(SyntheticSequence{options}, std::invalid_argument);
  EXPECT_THROW((void)SyntheticSequence(small(SequenceKind::kRoom)).frame(20), std::out_of_range);
}

TEST(SyntheticSequence, AnotherFrameRateSeesTheSameMotion) {
  for (const SequenceKind kind : {SequenceKind::kStreet, SequenceKind::kRoom}) {
    SequenceOptions options = small(kind);
    const SyntheticSequence usual(options);
    options.rate = 2 / usual.timestamp(1);
    const SyntheticSequence twice(options);
    EXPECT_DOUBLE_EQ(twice.timestamp(6), usual.timestamp(3));
    EXPECT_LT((twice.pose(6).inverse() * usual.pose(3)).log().norm(), 1e-12);
    options.rate = 0;
    options.readout = 1.5 * usual.timestamp(1);
    EXPECT_THROW(SyntheticSequence{options}, std::invalid_argument);
    options.rate = 0.5 / usual.timestamp(1);
    EXPECT_NO_THROW(SyntheticSequence{options});
  }
}

TEST(Sensor, InverseResponseInvertsTheForwardOne) {
  const std::vector<double> inverse = makeInverseResponse(true);
  for (std::size_t value = 0; value < inverse.size(); ++value) {
    EXPECT_NEAR(forwardResponse(inverse[value], true), static_cast<double>(value), 1e-9);
  }
}

}  // namespace
}  // namespace dsorb::synthetic
