// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/left_out_tracks.h"
#include "support/two_view_scene.h"

#include <gtest/gtest.h>

#include <cstdint>

namespace dsorb::init_orb {
namespace {

constexpr std::uint64_t kRivalSeed = 3;

/// A world, and an object before it over the middle of the image that moves by itself.
class RivalMotion : public testing::Test {
 protected:
  void show(int of_world, int of_object) {
    Random random(kRivalSeed);
    int world = 0;
    int object = 0;
    while (world < of_world || object < of_object) {
      const Eigen::Vector2d pixel{random.uniform(5, 635), random.uniform(5, 475)};
      const bool on_object = pixel.x() > 200 && pixel.x() < 440 && pixel.y() > 200;
      int& count = on_object ? object : world;
      if (count >= (on_object ? of_object : of_world)) continue;
      const double depth = on_object ? random.uniform(3, 4) : random.uniform(5, 15);
      const SE3& motion = on_object ? T_object_ : T_world_;
      Eigen::Vector2d target = camera_.project(motion * (depth * camera_.unproject(pixel)));
      if (!camera_.contains(target)) continue;
      target += 0.1 * Eigen::Vector2d{random.gaussian(), random.gaussian()};
      matches_.reference.push_back(pixel);
      matches_.target.push_back(target);
      ++count;
    }
  }
  void mismatch(int count) {
    Random random(kRivalSeed + 1);
    for (int i = 0; i < count; ++i) {
      matches_.reference.emplace_back(random.uniform(5, 635), random.uniform(5, 475));
      matches_.target.emplace_back(random.uniform(5, 635), random.uniform(5, 475));
    }
  }
  [[nodiscard]] bool hasRival(const SE3& motion) const {
    return init_orb::hasRival(motion, matches_, camera_, kRivalSeed);
  }

  PinholeCamera camera_{450, 450, 319.5, 239.5, 640, 480};
  SE3 T_world_{so3Exp({0, 0.01, 0}), {0.05, 0, -1}};
  SE3 T_object_{so3Exp({0, 0.01, 0.01}), {0.3, 0.02, -0.1}};
  Matches matches_;
};

TEST_F(RivalMotion, IsThatOfTheWorldAroundAnObjectWithMoreCorners) {
  show(120, 300);
  EXPECT_TRUE(hasRival(T_object_));
}

TEST_F(RivalMotion, IsNotThatOfAnObjectWithFewerCornersBeforeTheWorld) {
  show(300, 120);
  EXPECT_FALSE(hasRival(T_world_));
  EXPECT_TRUE(hasRival(T_object_));
}

TEST_F(RivalMotion, IsNotThatOfFewMatches) {
  show(30, 300);
  EXPECT_FALSE(hasRival(T_object_));
}

TEST_F(RivalMotion, IsNotThatOfMismatches) {
  show(0, 300);
  mismatch(150);
  EXPECT_FALSE(hasRival(T_object_));
}

TEST_F(RivalMotion, MayBeThatOfAWorldThatStands) {
  T_world_ = SE3();
  T_object_ = SE3(so3Exp({0.03, 0.01, 0.05}), {0.3, 0.02, -0.1});
  show(120, 300);
  EXPECT_TRUE(hasRival(T_object_));
}

}  // namespace
}  // namespace dsorb::init_orb
