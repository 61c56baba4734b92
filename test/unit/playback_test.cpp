// SPDX-License-Identifier: BSD-3-Clause
#include "app/playback.h"

#include <gtest/gtest.h>

#include <vector>

namespace dsorb::app {
namespace {

const std::vector<double> kTenHertz = {5.0, 5.1, 5.2, 5.3, 5.4};

/// Ten a second.
std::vector<double> twelveImages() {
  std::vector<double> times;
  for (int image = 0; image < 12; ++image) times.push_back(5 + 0.1 * image);
  return times;
}

/// Plays on a clock of its own with this much work an image.
/// @return positions of the images taken
std::vector<int> play(Playback playback, std::size_t images, double work) {
  double now = 100;
  std::vector<int> taken;
  for (int position = 0; position < static_cast<int>(images); ++position) {
    Playback::Step step = playback.next(now);
    if (step.wait > 0) {
      now += step.wait + 1e-9;
      step = playback.next(now);
    }
    EXPECT_EQ(step.wait, 0);
    position += step.drop;
    taken.push_back(position);
    now += work;
  }
  EXPECT_EQ(playback.dropped() + static_cast<int>(taken.size()), static_cast<int>(images));
  return taken;
}

TEST(Playback, SpeedZeroGivesEveryImageAtOnce) {
  Playback playback(kTenHertz, 0);
  for (std::size_t i = 0; i < kTenHertz.size(); ++i) {
    const Playback::Step step = playback.next(1e6 * static_cast<double>(i));
    EXPECT_EQ(step.wait, 0);
    EXPECT_EQ(step.drop, 0);
  }
  EXPECT_EQ(playback.dropped(), 0);
}

TEST(Playback, TheFirstImageIsThereAtOnceTheOthersAtTheirTime) {
  Playback playback(kTenHertz, 2);
  EXPECT_EQ(playback.next(1000).wait, 0);
  EXPECT_NEAR(playback.next(1000.02).wait, 0.03, 1e-9);
  EXPECT_NEAR(playback.next(1000.04).wait, 0.01, 1e-9) << "asking takes no image";
  EXPECT_EQ(playback.next(1000.06).wait, 0);
}

TEST(Playback, SaysWhetherTheNextImageIsThereToo) {
  Playback playback(kTenHertz, 1);
  EXPECT_FALSE(playback.next(1000).late);
  EXPECT_FALSE(playback.next(1000.15).late);
  EXPECT_TRUE(playback.next(1000.31).late);
  EXPECT_FALSE(playback.next(1000.32).late);
  EXPECT_FALSE(playback.next(1000.9).late) << "nothing is behind the last one";
  EXPECT_FALSE(Playback(kTenHertz, 0).next(1000).late);
}

TEST(Playback, WhoIsFastEnoughGetsEveryImage) {
  EXPECT_EQ(play(Playback(kTenHertz, 1), 5, 0.09), (std::vector<int>{0, 1, 2, 3, 4}));
}

TEST(Playback, WhoIsLateFindsTheNewestFourImages) {
  // After a second images 0 to 10 have come, and 7 to 10 are still there.
  EXPECT_EQ(play(Playback(twelveImages(), 1), 12, 1), (std::vector<int>{0, 7, 8, 9, 10, 11}));
  EXPECT_EQ(play(Playback(twelveImages(), 4), 12, 0.25), (std::vector<int>{0, 7, 8, 9, 10, 11}));
  EXPECT_EQ(play(Playback(twelveImages(), 1), 12, 100), (std::vector<int>{0, 8, 9, 10, 11}));
}

TEST(Playback, WhoIsLateAFewTimesCatchesUp) {
  Playback playback(twelveImages(), 1);
  double now = 0;
  for (int image = 0; image < 12; ++image) {
    const double wait = playback.next(now).wait;
    if (wait > 0) {
      now += wait + 1e-9;
      EXPECT_EQ(playback.next(now).wait, 0);
    }
    now += image == 3 ? 0.35 : 0.05;
  }
  EXPECT_EQ(playback.dropped(), 0);
}

TEST(Playback, ReversedTimesPlayTheSame) {
  const std::vector<double> times = twelveImages();
  const std::vector<double> reversed(times.rbegin(), times.rend());
  EXPECT_EQ(play(Playback(reversed, 1), 12, 1), (std::vector<int>{0, 7, 8, 9, 10, 11}));
}

TEST(Playback, EqualTimesAndNoImagesAreFine) {
  EXPECT_EQ(play(Playback({1, 1, 1}, 1), 3, 0.5), (std::vector<int>{0, 1, 2}));
  Playback none({}, 1);
  EXPECT_EQ(none.next(0).wait, 0);
}

}  // namespace
}  // namespace dsorb::app
