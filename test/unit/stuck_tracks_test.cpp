// SPDX-License-Identifier: BSD-3-Clause
#include "image/stuck_regions.h"
#include "init/orb/left_out_tracks.h"
#include "support/two_view_scene.h"

#include <gtest/gtest.h>

#include <limits>

namespace dsorb::init_orb {
namespace {

constexpr std::uint64_t kStuckSeed = 5;

/// Tracks of a scene over three frames, and of a rectangle that moves with the camera.
class StuckTracks : public testing::Test {
 protected:
  /// @param turn of the camera [rad]
  void observe(double turn, const Eigen::Vector3d& translation) {
    T_cur_ref_ = SE3(so3Exp(turn * Eigen::Vector3d(0.1, 1, 0)), translation);
    tracks_.positions.assign(3, {});
    Random random(kStuckSeed);
    while (tracks_.size() < 200) {
      const Eigen::Vector2d pixel{random.uniform(5, 635), random.uniform(5, 475)};
      see(pixel, random.uniform(4, 12));
    }
  }
  void see(const Eigen::Vector2d& pixel, double depth) {
    const Eigen::Vector2d target = camera_.project(T_cur_ref_ * (depth * camera_.unproject(pixel)));
    if (camera_.contains(target)) add(pixel, target);
  }
  void stick(int count, double height) {
    Random random(kStuckSeed + 1);
    for (int i = 0; i < count; ++i) {
      const Eigen::Vector2d pixel{random.uniform(5, 635), random.uniform(475 - height, 475)};
      add(pixel, pixel + Eigen::Vector2d{0.1 * random.gaussian(), 0.1 * random.gaussian()});
    }
  }
  std::vector<Eigen::Vector2f> leaveOut() { return leaveOutStuck(tracks_, camera_, kStuckSeed); }

  PinholeCamera camera_{450, 450, 319.5, 239.5, 640, 480};
  CornerTracks tracks_;

 private:
  SE3 T_cur_ref_;
  void add(const Eigen::Vector2d& pixel, const Eigen::Vector2d& target) {
    tracks_.positions[0].push_back(pixel.cast<float>());
    tracks_.positions[1].push_back((0.5 * (pixel + target)).cast<float>());
    tracks_.positions[2].push_back(target.cast<float>());
  }
};

TEST_F(StuckTracks, OfABonnetAreLeftOutWhereTheCameraTurns) {
  observe(0.02, {0.3, 0, 0.1});
  stick(250, 80);  // more than the others, over a sixth of the image
  tracks_.seen = tracks_.positions.front();
  tracks_.positions[1][200] = Eigen::Vector2f::Constant(std::numeric_limits<float>::quiet_NaN());
  const auto kept = std::vector<Eigen::Vector2f>(tracks_.positions[2].begin(),
                                                 tracks_.positions[2].begin() + 200);
  EXPECT_EQ(leaveOut().size(), 250U);
  EXPECT_EQ(tracks_.positions[2], kept);
  EXPECT_EQ(tracks_.positions[1].size(), 200U);
  EXPECT_EQ(tracks_.seen.size(), 200U);
}

TEST_F(StuckTracks, MayBeFarAwayWhereTheCameraDoesNotTurn) {
  observe(0, {0, 0, 0.4});
  stick(60, 80);
  EXPECT_EQ(leaveOut().size(), 0U);
  EXPECT_EQ(tracks_.size(), 260);
}

TEST_F(StuckTracks, MayBeWhatTheCameraTurnsAround) {
  observe(0.05, {-0.4, 0.04, 0});
  Random random(kStuckSeed);
  for (int i = 0; i < 20; ++i) {
    const Eigen::Vector2d pixel{random.uniform(300, 340), random.uniform(220, 260)};
    see(pixel, 8);  // where the axes of both cameras meet
    ASSERT_LT((tracks_.positions[2].back() - tracks_.positions[0].back()).norm(), 0.5F);
  }
  EXPECT_EQ(leaveOut().size(), 0U);
}

TEST_F(StuckTracks, AreTheSceneWhereTheyAreAllOverTheImage) {
  observe(0.02, {0.3, 0, 0.1});
  stick(400, 300);
  EXPECT_EQ(leaveOut().size(), 0U) << "a standing camera, traffic above";
}

TEST_F(StuckTracks, AreFewInAnyScene) {
  observe(0.02, {0.3, 0, 0.1});
  stick(4, 80);
  EXPECT_EQ(leaveOut().size(), 0U);
}

TEST(StuckRegions, AreTheSquaresAroundPixels) {
  const StuckRegions regions({{40, 40}, {639, 479}}, 640, 480);
  std::vector<SelectedPixel> selected = {{31, 40}, {32, 32}, {63, 63}, {64, 40}, {620, 460}};
  regions.removeFrom(selected);
  ASSERT_EQ(selected.size(), 2U);
  EXPECT_EQ(selected[0].x, 31);
  EXPECT_EQ(selected[1].x, 64);
  StuckRegions().removeFrom(selected);
  EXPECT_EQ(selected.size(), 2U);
}

}  // namespace
}  // namespace dsorb::init_orb
