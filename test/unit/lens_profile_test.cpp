// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/start/lens_profile.h"

#include "camera/lens_models.h"
#include "init/orb/bundle/geometric_covariance.h"
#include "init/orb/bundle/robust_adjustment.h"
#include "support/synthetic_map.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <optional>

namespace dsorb::init_orb {
namespace {

GeometricOptions lensOptions() {
  GeometricOptions options;
  options.sigma = 0.1;
  return options;
}

/// What is said of a calibration whose focal length is `factor` times the true one, and which does
/// not know that the lens distorts.
std::optional<OtherLens> askedWith(double factor, double radial, std::uint64_t seed) {
  SyntheticMap scene = makeSyntheticMap({400, 6, 0.1, 0}, seed);
  InitialMap& map = scene.start;
  PinholeCamera camera = scene.camera;
  const Lens lens{LensModel::kRadTan, camera.fx, camera.fy, camera.cx, camera.cy, {radial}};
  const auto distort = [&](Eigen::Vector2d& pixel) {
    pixel = projectThroughLens(lens, camera.unproject(pixel).head<2>());
  };
  for (Corner& corner : map.corners) distort(corner.pixel);
  for (CornerObservation& observation : map.observations) distort(observation.pixel);
  camera.fx *= factor;
  camera.fy *= factor;
  EXPECT_TRUE(solveGeometry(map, camera, lensOptions()));
  EXPECT_TRUE(normalizeCornerScale(map));
  setCovariances(map, camera, lensOptions());
  return profileLens(map, camera, lensOptions());
}

TEST(LensProfile, RightCalibrationIsNotSuspected) {
  for (const std::uint64_t seed : {1U, 2U, 3U, 4U, 5U}) {
    const auto other = askedWith(1, 0, seed);
    ASSERT_TRUE(other);
    EXPECT_LT(other->score.gain, 0);  // measured -28 to -31
    EXPECT_FALSE(other->score.suspicious());
  }
}

TEST(LensProfile, WrongFocalLengthIs) {
  for (const std::uint64_t seed : {1U, 2U, 3U}) {
    for (const double factor : {0.5, 2.0}) {
      const auto other = askedWith(factor, 0, seed);
      ASSERT_TRUE(other);
      EXPECT_TRUE(other->score.suspicious()) << factor;  // measured: gains of 13 to 17; limit 4.5
      EXPECT_EQ(other->score.focal_factor > 1, factor < 1);
    }
  }
}

TEST(LensProfile, DistortionThatTheCalibrationDoesNotHaveIs) {
  for (const std::uint64_t seed : {1U, 2U, 3U}) {
    for (const double radial : {-0.2, 0.2}) {
      const auto other = askedWith(1, radial, seed);
      ASSERT_TRUE(other);
      EXPECT_TRUE(other->score.suspicious()) << radial;  // measured: gains of 13 to 28
      EXPECT_EQ(other->score.radial > 0, radial > 0);
    }
  }
}

}  // namespace
}  // namespace dsorb::init_orb
