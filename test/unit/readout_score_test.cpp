// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/bundle/geometric_covariance.h"
#include "init/orb/bundle/map_assembly.h"
#include "init/orb/bundle/robust_adjustment.h"
#include "init/orb/start/readout.h"
#include "support/synthetic_map.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <vector>

namespace dsorb::init_orb {
namespace {

constexpr double kNoise = 0.1;  // [px]

GeometricOptions someOptions() {
  GeometricOptions options;
  options.sigma = kNoise;
  return options;
}

/// A map adjusted as that of a global shutter, of images whose rows took a while.
SyntheticMap adjustedMap(double readout, std::uint64_t seed) {
  SyntheticMap scene = makeSyntheticMap({400, 6, kNoise, 0}, seed);
  static const std::vector<std::uint8_t> kGrey(std::size_t{640} * 480, 100);
  for (std::size_t k = 0; k < scene.start.frames.size(); ++k) {
    const auto index = static_cast<int>(k);
    scene.start.frames[k].frame =
        Frame::create({kGrey.data(), 640, 480}, {FrameId{index}, index / 30.0});
  }
  InitialMap& map = scene.start;
  const std::vector<RowMotion> motions = motionsByPoses(map, scene.camera);
  const auto time = [&](const Eigen::Vector2d& pixel) {
    return readout * (pixel.y() / (scene.camera.height - 1) - 0.5);
  };
  for (CornerObservation& observation : map.observations) {
    const auto projection = projectCorner(map, scene.camera, observation);
    const Eigen::Vector2d place = observation.pixel;
    observation.pixel += projection->J_pose * (time(place) * motions[observation.frame].velocity);
  }
  for (Corner& corner : map.corners) {
    const auto projection = projectHosted(
        scene.camera, SE3(), scene.camera.unproject(corner.pixel), corner.inverse_depth);
    corner.pixel += projection->J_pose * (time(corner.pixel) * motions.front().velocity);
  }
  EXPECT_TRUE(solveGeometry(map, scene.camera, someOptions()));
  EXPECT_TRUE(normalizeCornerScale(map));
  setCovariances(map, scene.camera, someOptions());
  return scene;
}

TEST(ReadoutScore, FindsWhatTheRowsDid) {
  for (const double readout : {-0.02, 0.0, 0.02}) {
    const SyntheticMap scene = adjustedMap(readout, 3);
    const auto score = scoreReadout(scene.start, scene.camera, someOptions());
    ASSERT_TRUE(score);
    // Measured: -16.8, 0.0 and 18.1 ms, 2.4 and 2.0 sigma off 0.
    EXPECT_LT(std::abs(score->seconds - readout), 0.005) << readout;
    EXPECT_LT(std::abs(score->seconds - readout), 2 * score->sigma) << readout;
    EXPECT_EQ(std::abs(score->seconds) > 1.5 * score->sigma, readout != 0) << readout;
  }
}

TEST(ReadoutScore, SigmaIsThatOfItsErrors) {
  constexpr int kMaps = 40;
  double square = 0;
  for (int seed = 1; seed <= kMaps; ++seed) {
    const SyntheticMap scene = adjustedMap(0, static_cast<std::uint64_t>(seed));
    const auto score = scoreReadout(scene.start, scene.camera, someOptions());
    ASSERT_TRUE(score);
    square += score->seconds * score->seconds / (score->sigma * score->sigma) / kMaps;
  }
  // Measured: 0.21.
  EXPECT_GT(square, 0.07);
  EXPECT_LT(square, 1);
}

}  // namespace
}  // namespace dsorb::init_orb
