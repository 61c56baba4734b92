// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/bundle/reprojection_equations.h"

#include "base/parallel.h"
#include "estimate/warp.h"
#include "support/jacobian_check.h"
#include "support/synthetic_map.h"

#include <gtest/gtest.h>

namespace dsorb::init_orb {
namespace {

GeometricOptions optionsWith(RobustLoss loss) {
  GeometricOptions options;
  options.loss = loss;
  options.sigma = 0.7;
  return options;
}

/// Not a whole number of lanes, whitened, some observations missing.
SyntheticMap someMap() {
  SyntheticMap scene = makeSyntheticMap({151, 5, 1.5, 0.05}, 3);
  Random random(4);
  std::vector<CornerObservation> kept;
  for (CornerObservation& observation : scene.start.observations) {
    if (random.uniform() < 0.1) continue;
    observation.whitening << 1.2, 0, random.uniform(-0.3, 0.3), 0.9;
    kept.push_back(observation);
  }
  scene.start.observations = kept;
  return scene;
}

Eigen::VectorXd asVector(const std::vector<double>& values) {
  return Eigen::Map<const Eigen::VectorXd>(values.data(), static_cast<Eigen::Index>(values.size()));
}

/// As they are defined, observation by observation.
ReprojectionEquations ceresEquations(const SyntheticMap& scene,
                                     const UnknownRows& rows,
                                     const GeometricOptions& options) {
  const InitialMap& map = scene.start;
  ReprojectionEquations e;
  LinearSystem<double>& system = e.system;
  system.reset(rows.size(), wholeLanes(map.corners.size()));
  for (const CornerObservation& o : map.observations) {
    const Corner& corner = map.corners[o.corner];
    const auto projection = projectHosted(scene.camera,
                                          *map.frames[o.frame].T_cam_ref,
                                          scene.camera.unproject(corner.pixel),
                                          corner.inverse_depth);
    const int row = rows.first[o.frame];
    const Eigen::Matrix2d whitening = o.whitening / options.sigma;
    const Eigen::Vector2d r = whitening * (projection->pixel - o.pixel);
    const Eigen::Matrix<double, 2, 6> J = whitening * projection->J_pose;
    const Eigen::Vector2d d = whitening * projection->J_inverse_depth;
    const double weight = robustWeight(r.norm(), options);
    const auto corner_index = o.corner;
    system.H.block<6, 6>(row, row) += weight * J.transpose() * J;
    system.b.segment<6>(row) += weight * J.transpose() * r;
    Eigen::Map<Vector6d>(system.coupling.data() + corner_index * system.stride + row) +=
        weight * J.transpose() * d;
    system.depth_hessian[corner_index] += weight * d.squaredNorm();
    system.depth_gradient[corner_index] += weight * d.dot(r);
    e.weighted_square += weight * r.squaredNorm();
    e.rows += 2;
    e.cost += robustCost(r.norm(), options);
  }
  return e;
}

TEST(ReprojectionEquations, InLanesEqualThoseOneByOne) {
  const SyntheticMap scene = someMap();
  const UnknownRows rows(scene.start);
  for (const RobustLoss loss : {RobustLoss::kHuber, RobustLoss::kCauchy}) {
    const GeometricOptions options = optionsWith(loss);
    const ReprojectionEquations expected = ceresEquations(scene, rows, options);
    const ReprojectionEquations made = linearize(scene.start, rows, scene.camera, options);
    EXPECT_LT(relativeDifference(made.system.H, expected.system.H), 1e-12);
    EXPECT_LT(relativeDifference(made.system.couplings(), expected.system.couplings()), 1e-12);
    EXPECT_LT(relativeDifference(asVector(made.system.depth_hessian),
                                 asVector(expected.system.depth_hessian)),
              1e-12);
    EXPECT_LT(relativeDifference(made.system.b, expected.system.b), 1e-10);
    EXPECT_LT(relativeDifference(asVector(made.system.depth_gradient),
                                 asVector(expected.system.depth_gradient)),
              1e-10);
    EXPECT_NEAR(made.weighted_square / expected.weighted_square, 1, 1e-12);
    EXPECT_EQ(made.rows, expected.rows);
    EXPECT_NEAR(*reprojectionCost(scene.start, scene.camera, options) / expected.cost, 1, 1e-12);
  }
}

TEST(ReprojectionEquations, HaveNoCostWhereAPointIsBehindACamera) {
  SyntheticMap scene = someMap();
  scene.start.frames[2].T_cam_ref = SE3(Eigen::Matrix3d::Identity(), {0, 0, -10});
  const GeometricOptions options = optionsWith(RobustLoss::kHuber);
  EXPECT_FALSE(reprojectionCost(scene.start, scene.camera, options));
  // The others still count.
  const UnknownRows rows(scene.start);
  EXPECT_GT(linearize(scene.start, rows, scene.camera, options).rows, 500);
}

TEST(ReprojectionEquations, AreBitIdenticalForAnyNumberOfThreads) {
  const SyntheticMap scene = someMap();
  const UnknownRows rows(scene.start);
  const auto make = [&] {
    return linearize(scene.start, rows, scene.camera, optionsWith(RobustLoss::kCauchy));
  };
  const ReprojectionEquations one = TaskArena(1).run(make);
  const ReprojectionEquations two = TaskArena(2).run(make);
  EXPECT_EQ(one.system.H, two.system.H);
  EXPECT_EQ(one.system.couplings(), two.system.couplings());
  EXPECT_EQ(one.system.b, two.system.b);
}

}  // namespace
}  // namespace dsorb::init_orb
