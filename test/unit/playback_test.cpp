// SPDX-License-Identifier: BSD-3-Clause
#include "app/playback.h"

#include <gtest/gtest.h>

#include <vector>

namespace dsorb::app {
namespace {

const std::vector<double> kTenHertz = {5.0, 5.1, 5.2, 5.3, 5.4};

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

TEST(Playback, WhoIsFastEnoughGetsEveryImage) {
  EXPECT_EQ(play(Playback(kTenHertz, 1), 5, 0.09), (std::vector<int>{0, 1, 2, 3, 4}));
}

TEST(Playback, WhoIsLateFindsTheNewestImage) {
  EXPECT_EQ(play(Playback(kTenHertz, 1), 5, 0.21), (std::vector<int>{0, 2, 4}));
  EXPECT_EQ(play(Playback(kTenHertz, 1), 5, 0.12), (std::vector<int>{0, 1, 2, 3, 4}))
      << "20 ms late each time, never a whole image in five";
  EXPECT_EQ(play(Playback(kTenHertz, 1), 5, 10), (std::vector<int>{0, 4})) << "the last remains";
  EXPECT_EQ(play(Playback(kTenHertz, 4), 5, 0.06), (std::vector<int>{0, 2, 4}));
}

TEST(Playback, ReversedTimesPlayTheSame) {
  const std::vector<double> reversed(kTenHertz.rbegin(), kTenHertz.rend());
  EXPECT_EQ(play(Playback(reversed, 1), 5, 0.21), (std::vector<int>{0, 2, 4}));
}

TEST(Playback, EqualTimesAndNoImagesAreFine) {
  EXPECT_EQ(play(Playback({1, 1, 1}, 1), 3, 0.5), (std::vector<int>{0, 1, 2}));
  Playback none({}, 1);
  EXPECT_EQ(none.next(0).wait, 0);
}

}  // namespace
}  // namespace dsorb::app
