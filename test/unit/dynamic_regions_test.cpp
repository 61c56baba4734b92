// SPDX-License-Identifier: BSD-3-Clause
#include "base/random.h"
#include "init/orb/left_out_tracks.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>

namespace dsorb::init_orb {
namespace {

const PinholeCamera kCamera{400, 400, 319.5, 239.5, 640, 480};
constexpr int kFrames = 5;
constexpr std::size_t kCorners = 800;

bool onBox(const Eigen::Vector2f& pixel) {
  return pixel.x() > 200 && pixel.x() < 340 && pixel.y() > 150 && pixel.y() < 330;
}

/// A camera that moves ahead and a part of the image that moves by itself.
struct Scene {
  InitialMap map;
  CornerTracks tracks;
};

/// @param own_motion of the box [unit per frame]
Scene makeScene(const Eigen::Vector3d& own_motion, std::uint64_t seed = 7) {
  Scene scene;
  Random random(seed);
  scene.tracks.positions.resize(kFrames);
  for (int k = 0; k < kFrames; ++k) {
    const SE3 pose(Eigen::Quaterniond::Identity(), {0.02 * k, 0, -0.1 * k});
    scene.map.frames.push_back({nullptr, pose, {}, {}});
  }
  for (std::size_t i = 0; i < kCorners; ++i) {
    const Eigen::Vector2d pixel{random.uniform(20, 620), random.uniform(20, 460)};
    const double depth = random.uniform(2, 6);
    const bool moves = onBox(pixel.cast<float>());
    scene.map.corners.push_back({pixel, 1 / depth, 1e-4});
    scene.map.points.push_back({0, pixel.cast<float>(), static_cast<float>(1 / depth), 1e-4F, 4});
    for (int k = 0; k < kFrames; ++k) {
      Eigen::Vector3d p = depth * kCamera.unproject(pixel);
      if (moves) p += k * own_motion;
      const Eigen::Vector2d noise{random.gaussian(), random.gaussian()};
      const Eigen::Vector2d seen =
          kCamera.project(*scene.map.frames[static_cast<std::size_t>(k)].T_cam_ref * p) +
          (k > 0 ? 0.1 : 0.0) * noise;
      scene.tracks.positions[static_cast<std::size_t>(k)].push_back(seen.cast<float>());
      if (k > 0) {
        scene.map.observations.push_back(
            {scene.map.corners.size() - 1, static_cast<std::size_t>(k), seen});
      }
    }
  }
  return scene;
}

TEST(DynamicRegions, ErrorsOfStaticTracksAreThoseOfTheTracking) {
  const Scene scene = makeScene(Eigen::Vector3d::Zero());
  std::vector<double> errors = trackErrors(scene.map, scene.tracks, kCamera);
  std::nth_element(errors.begin(), errors.begin() + 400, errors.end());
  // Two coordinates of 0.1 px, one of the eight degrees of freedom is spent.
  EXPECT_NEAR(errors[400], 0.1 * std::sqrt(2 * 7.0 / 8.0), 0.02);
}

TEST(DynamicRegions, AreNoneInAStaticScene) {
  Scene scene = makeScene(Eigen::Vector3d::Zero());
  DynamicRegions(scene.map, scene.tracks, kCamera).removeFrom(scene.map);
  EXPECT_EQ(scene.map.corners.size(), kCorners);
  EXPECT_EQ(scene.map.points.size(), kCorners);
}

TEST(DynamicRegions, AreWhereTracksContradictTheCamera) {
  const auto of_box = [](const auto& list) {
    return std::count_if(list.begin(), list.end(), [](const auto& point) {
      return onBox(point.pixel.template cast<float>());
    });
  };
  std::ptrdiff_t on_box = 0;
  std::ptrdiff_t corners_left = 0;
  std::ptrdiff_t points_left = 0;
  std::ptrdiff_t removed = 0;
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    Scene scene = makeScene({0.05, 0.02, 0}, seed);
    on_box += of_box(scene.map.corners);
    DynamicRegions(scene.map, scene.tracks, kCamera).removeFrom(scene.map);
    EXPECT_EQ(scene.map.corners.size(), scene.map.points.size());  // they were at the same places
    removed += static_cast<std::ptrdiff_t>(kCorners - scene.map.corners.size());
    corners_left += of_box(scene.map.corners);
    points_left += of_box(scene.map.points);
    EXPECT_EQ(scene.map.observations.size(), scene.map.corners.size() * (kFrames - 1));
    for (const CornerObservation& observation : scene.map.observations) {
      ASSERT_LT(observation.corner, scene.map.corners.size());
      const Corner& corner = scene.map.corners[observation.corner];
      EXPECT_LT((observation.pixel - corner.pixel).norm(), 200);
    }
  }
  EXPECT_GT(on_box, 20 * 30);
  EXPECT_LE(corners_left, on_box / 10);  // measured 6.4 %
  EXPECT_LE(points_left, on_box / 10);
  EXPECT_LE(removed, on_box * 12 / 10);  // measured .96; a rim around it goes, too
}

TEST(DynamicRegions, OneBadTrackIsNoRegion) {
  Scene scene = makeScene(Eigen::Vector3d::Zero());
  scene.tracks.positions.back()[100] += Eigen::Vector2f(30, 40);
  DynamicRegions(scene.map, scene.tracks, kCamera).removeFrom(scene.map);
  EXPECT_EQ(scene.map.corners.size(), kCorners);
}

}  // namespace
}  // namespace dsorb::init_orb
