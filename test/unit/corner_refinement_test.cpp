// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/bundle/corner_refinement.h"

#include "base/random.h"
#include "estimate/warp.h"
#include "support/assign_map.h"
#include "support/matchers.h"
#include "support/plane_scene.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace dsorb::init_orb {
namespace {

/// A map of a rendered plane whose tracks are disturbed; poses and inverse depths start near truth.
struct DisturbedMap {
  PlaneScene scene{5};
  std::vector<SE3> truth;
  InitialMap map;
};

DisturbedMap makeDisturbedMap(double disturbance) {
  DisturbedMap made;
  Random random(9);
  InitialMap& map = made.map;
  for (int k = 0; k < 4; ++k) {
    const double path = k / 3.0;
    made.truth.emplace_back(so3Exp({0.01 * path, -0.02 * path, 0.03 * path}),
                            Eigen::Vector3d(0.08 * path, 0.02 * path, 0.06 * path));
    const SE3& pose = made.truth.back();
    map.frames.push_back({made.scene.render(pose, 1, k, {1 + 0.05 * k, 2.0 * k}), pose, {}, {}});
  }
  const PinholeCamera& camera = made.scene.camera();
  for (int i = 0; i < 150; ++i) {
    Corner corner;
    corner.pixel = {random.uniform(0.15, 0.85) * camera.width,
                    random.uniform(0.15, 0.85) * camera.height};
    corner.inverse_depth = made.scene.inverseDepth(corner.pixel) * random.uniform(0.97, 1.03);
    map.corners.push_back(corner);
    for (std::size_t k = 1; k < 4; ++k) {
      const auto projection = projectHosted(camera,
                                            made.truth[k],
                                            camera.unproject(corner.pixel),
                                            made.scene.inverseDepth(corner.pixel));
      const Eigen::Vector2d noise{random.gaussian(), random.gaussian()};
      map.observations.push_back(
          {map.corners.size() - 1, k, projection->pixel + disturbance * noise});
    }
  }
  return made;
}

double rmsError(const DisturbedMap& made) {
  double sum = 0;
  for (const CornerObservation& observation : made.map.observations) {
    const Corner& corner = made.map.corners[observation.corner];
    const auto truth = projectHosted(made.scene.camera(),
                                     made.truth[observation.frame],
                                     made.scene.camera().unproject(corner.pixel),
                                     made.scene.inverseDepth(corner.pixel));
    sum += (truth->pixel - observation.pixel).squaredNorm();
  }
  return std::sqrt(sum / (2 * static_cast<double>(made.map.observations.size())));
}

void expectSame(const InitialMap& a, const InitialMap& b) {
  ASSERT_EQ(a.corners.size(), b.corners.size());
  for (std::size_t i = 0; i < a.corners.size(); ++i) {
    EXPECT_EQ(a.corners[i].pixel, b.corners[i].pixel) << i;
    EXPECT_EQ(a.corners[i].inverse_depth, b.corners[i].inverse_depth) << i;
  }
  ASSERT_EQ(a.observations.size(), b.observations.size());
  for (std::size_t i = 0; i < a.observations.size(); ++i) {
    EXPECT_EQ(a.observations[i].pixel, b.observations[i].pixel) << i;
    EXPECT_EQ(a.observations[i].whitening, b.observations[i].whitening) << i;
  }
  ASSERT_EQ(a.frames.size(), b.frames.size());
  for (std::size_t k = 0; k < a.frames.size(); ++k) {
    EXPECT_EQ(a.frames[k].T_cam_ref->matrix(), b.frames[k].T_cam_ref->matrix()) << k;
    EXPECT_EQ(a.frames[k].affine.a, b.frames[k].affine.a) << k;
    EXPECT_EQ(a.frames[k].affine.b, b.frames[k].affine.b) << k;
  }
}

TEST(CornerRefinement, ReducesTheErrorOfDisturbedTracks) {
  DisturbedMap made = makeDisturbedMap(0.4);
  const double before = rmsError(made);
  GeometricOptions geometric;
  geometric.sigma = 0.4;
  const RefinementReport report = refineCorners(made.map, made.scene.camera(), geometric);
  ASSERT_TRUE(report.accepted) << report.first_rms << " " << report.last_rms;
  EXPECT_TRUE(report.fits);
  EXPECT_LT(rmsError(made), 0.35 * before);
  EXPECT_LT(report.last_rms, report.first_rms);
  EXPECT_LT(directionErrorDeg(made.map.frames.back().T_cam_ref->translation(),
                              made.truth.back().translation()),
            1.0);
}

TEST(CornerRefinement, KeepsTheMapWhereTheImagesDoNotFit) {
  DisturbedMap made = makeDisturbedMap(0.4);
  const PlaneScene other(77);
  for (std::size_t k = 1; k < made.map.frames.size(); ++k) {
    made.map.frames[k].frame = other.render(made.truth[k], 1, static_cast<int>(k));
  }
  const InitialMap before = made.map;
  const RefinementReport report = refineCorners(made.map, made.scene.camera(), GeometricOptions());
  EXPECT_FALSE(report.accepted);
  EXPECT_FALSE(report.fits);  // a start from such tracks is refused
  expectSame(made.map, before);
}

TEST(CornerRefinement, EndsAfterTheFirstRoundWhereItIsHopeless) {
  DisturbedMap ended = makeDisturbedMap(0.4);
  DisturbedMap all = ended;
  const PinholeCamera& camera = ended.scene.camera();
  GeometricOptions geometric;
  geometric.sigma = 0.4;
  int asked = 0;
  const auto answer = [&](bool hopeless) {
    return [&asked, hopeless](const InitialMap&) {
      ++asked;
      return hopeless;
    };
  };
  refineCorners(ended.map, camera, geometric, answer(true));
  EXPECT_EQ(asked, 1);
  refineCorners(all.map, camera, geometric, answer(false));
  EXPECT_EQ(asked, 2);
  EXPECT_LT(rmsError(all), rmsError(ended));
}

}  // namespace
}  // namespace dsorb::init_orb
