// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/left_out_tracks.h"
#include "support/painted_frame.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace dsorb::init_orb {
namespace {

constexpr int kSide = 240;

/// Bars, with blobs right of a column.
FramePtr bars(int column) {
  const Paint blob = blobs(1);
  return paintFrame(0, kSide, kSide, [=](float x, float y) {
    return x > static_cast<float>(column) ? blob(x, y) : 128 + 100 * std::sin(0.4F * x + 0.1F * y);
  });
}

CornerTracks tracksEverywhere() {
  CornerTracks tracks{{{}, {}}};
  for (int y = 10; y < kSide - 10; y += 10) {
    for (int x = 10; x < kSide - 10; x += 10) {
      tracks.positions[0].emplace_back(x, y);
      tracks.positions[1].emplace_back(x + 1, y);
    }
  }
  return tracks;
}

TEST(EdgeTracks, GoWhereMostAreOnEdges) {
  CornerTracks tracks = tracksEverywhere();
  leaveOutEdges(bars(kSide)->level(0), tracks);
  EXPECT_EQ(tracks.size(), 0);
}

TEST(EdgeTracks, LeaveTheCornersAmongThem) {
  CornerTracks tracks = tracksEverywhere();
  leaveOutEdges(bars(190)->level(0), tracks);
  ASSERT_GT(tracks.size(), 22 * 2);
  for (const Eigen::Vector2f& place : tracks.positions[0]) EXPECT_GT(place.x(), 180);
  EXPECT_EQ(tracks.positions[1][0].x(), tracks.positions[0][0].x() + 1);
}

TEST(EdgeTracks, StayWhereMostAreCorners) {
  CornerTracks tracks = tracksEverywhere();
  leaveOutEdges(bars(80)->level(0), tracks);
  EXPECT_EQ(tracks.size(), tracksEverywhere().size());
}

TEST(EdgeTracks, GoWhereBarsShowStepsOfPixels) {
  const FramePtr steps = paintFrame(0, kSide, kSide, [](float x, float y) {
    return 130 + 90 * std::clamp(8 * std::sin(0.3F * x + 0.1F * y), -1.0F, 1.0F);
  });
  CornerTracks tracks = tracksEverywhere();
  leaveOutEdges(steps->level(0), tracks);
  EXPECT_EQ(tracks.size(), 0);
}

}  // namespace
}  // namespace dsorb::init_orb
