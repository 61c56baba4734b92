// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/camera/row_times.h"

#include "init/orb/start/readout.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <memory>
#include <vector>

namespace dsorb::init_orb {
namespace {

constexpr int kRowFrames = 6;
constexpr int kTracks = 20;
constexpr double kInterval = 1.0 / 30;  // [s]

/// Where a point is at a time: a parabola with the speed of a quick hand [px].
Eigen::Vector2d place(int track, double t) {
  const Eigen::Vector2d start(40 + 28 * track, 30 + 21 * track);
  return start + t * Eigen::Vector2d(300, -200 + 10 * track) +
         t * t * Eigen::Vector2d(400, 500 - 20 * track);
}

FramePtr frameAt(int k, const std::shared_ptr<const RowTimes>& rows) {
  static const std::vector<std::uint8_t> kGrey(std::size_t{640} * 480, 100);
  return Frame::create({kGrey.data(), 640, 480}, {FrameId{k}, k * kInterval, 1, nullptr, rows});
}

TEST(MiddleRows, TracksBecomeThoseOfAGlobalShutter) {
  Lens lens{LensModel::kPinhole, 500, 500, 319.5, 239.5, {}, 640, 480};
  lens.readout = {0.025, 0};
  const auto rows =
      std::make_shared<const RowTimes>(rowTimes(lens, {500, 500, 319.5, 239.5, 640, 480}, false));
  CornerTracks tracks;
  std::vector<FramePtr> frames;
  double moved = 0;
  for (int k = 0; k < kRowFrames; ++k) {
    frames.push_back(frameAt(k, rows));
    tracks.positions.emplace_back();
    for (int i = 0; i < kTracks; ++i) {
      Eigen::Vector2d seen = place(i, k * kInterval);
      for (int n = 0; n < 20; ++n) seen = place(i, k * kInterval + rows->at(seen.x(), seen.y()));
      moved = std::max(moved, (seen - place(i, k * kInterval)).norm());
      tracks.positions.back().emplace_back(seen.cast<float>());
    }
  }
  EXPECT_GT(moved, 3);
  // Found by its descriptor: in the first and the last frame only.
  const float nowhere = std::numeric_limits<float>::quiet_NaN();
  for (std::size_t k = 0; k < kRowFrames; ++k) {
    const bool found = k == 0 || k + 1 == kRowFrames;
    const double t = static_cast<double>(k) * kInterval;
    Eigen::Vector2d seen(400, 100);
    for (int n = 0; n < 20; ++n) {
      seen = Eigen::Vector2d(400, 100) +
             (t + rows->at(seen.x(), seen.y())) * Eigen::Vector2d(300, 200);
    }
    tracks.positions[k].emplace_back(found ? Eigen::Vector2f(seen.cast<float>())
                                           : Eigen::Vector2f(nowhere, nowhere));
  }
  const CornerTracks corrected = atMiddleRows(tracks, frames);
  const Eigen::Vector2f& far = corrected.positions.back().back();
  EXPECT_LT((far - Eigen::Vector2f(450, 133.3333F)).norm(), 1e-3F);
  EXPECT_FALSE(corrected.positions[2].back().allFinite());
  const CornerTracks unmoved = atMiddleRows(tracks, frames, -0.025);  // a readout of 0
  EXPECT_EQ(corrected.seen, tracks.positions.front());
  for (int k = 0; k < kRowFrames; ++k) {
    for (int i = 0; i < kTracks; ++i) {
      const Eigen::Vector2f& found =
          corrected.positions[static_cast<std::size_t>(k)][static_cast<std::size_t>(i)];
      EXPECT_LT((found.cast<double>() - place(i, k * kInterval)).norm(), 1e-3) << k << " " << i;
      const auto frame = static_cast<std::size_t>(k);
      const auto track = static_cast<std::size_t>(i);
      // Single precision of the pixel.
      EXPECT_LT((unmoved.positions[frame][track] - tracks.positions[frame][track]).norm(), 1e-3F);
    }
  }
}

}  // namespace
}  // namespace dsorb::init_orb
