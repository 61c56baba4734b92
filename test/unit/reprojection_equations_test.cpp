// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/bundle/reprojection_equations.h"

#include "base/parallel.h"
#include "estimate/warp.h"
#include "support/jacobian_check.h"
#include "support/synthetic_map.h"

#include <gtest/gtest.h>

#include <cmath>

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
  std::vector<Observation> kept;
  for (Observation& observation : scene.start.observations) {
    if (random.uniform() < 0.1) continue;
    observation.whitening << 1.2, 0, random.uniform(-0.3, 0.3), 0.9;
    kept.push_back(observation);
  }
  scene.start.observations = kept;
  return scene;
}

/// The same, observation by observation.
ReprojectionEquations expectedEquations(const SyntheticMap& scene,
                                        const PoseRows& rows,
                                        const GeometricOptions& options,
                                        double& cost) {
  const InitialMap& map = scene.start;
  const auto corners = static_cast<Eigen::Index>(map.corners.size());
  ReprojectionEquations e{Eigen::MatrixXd::Zero(rows.size, rows.size),
                          Eigen::MatrixXd::Zero(rows.size, corners),
                          Eigen::VectorXd::Zero(corners),
                          Eigen::VectorXd::Zero(rows.size),
                          Eigen::VectorXd::Zero(corners)};
  cost = 0;
  for (const Observation& o : map.observations) {
    const Corner& corner = map.corners[static_cast<std::size_t>(o.corner)];
    const auto projection = projectHosted(scene.camera,
                                          *map.frames[static_cast<std::size_t>(o.frame)].T_cam_ref,
                                          scene.camera.unproject(corner.pixel),
                                          corner.inverse_depth);
    const int row = rows.first[static_cast<std::size_t>(o.frame)];
    const Eigen::Matrix2d whitening = o.whitening / options.sigma;
    const Eigen::Vector2d r = whitening * (projection->pixel - o.pixel);
    const Eigen::Matrix<double, 2, 6> J = whitening * projection->J_pose;
    const Eigen::Vector2d d = whitening * projection->J_inverse_depth;
    const double weight = robustWeight(r.norm(), options);
    e.pose_hessian.block<6, 6>(row, row) += weight * J.transpose() * J;
    e.pose_gradient.segment<6>(row) += weight * J.transpose() * r;
    e.coupling.col(o.corner).segment<6>(row) += weight * J.transpose() * d;
    e.depth_hessian[o.corner] += weight * d.squaredNorm();
    e.depth_gradient[o.corner] += weight * d.dot(r);
    e.weighted_error += weight * r.squaredNorm();
    e.rows += 2;
    cost += robustCost(r.norm(), options);
  }
  return e;
}

TEST(ReprojectionEquations, InLanesEqualThoseOneByOne) {
  const SyntheticMap scene = someMap();
  const PoseRows rows(scene.start);
  for (const RobustLoss loss : {RobustLoss::kHuber, RobustLoss::kCauchy}) {
    const GeometricOptions options = optionsWith(loss);
    double cost = 0;
    const ReprojectionEquations expected = expectedEquations(scene, rows, options, cost);
    const ReprojectionEquations made = linearize(scene.start, {}, rows, scene.camera, options);
    EXPECT_LT(relativeDifference(made.pose_hessian, expected.pose_hessian), 1e-12);
    EXPECT_LT(relativeDifference(made.coupling, expected.coupling), 1e-12);
    EXPECT_LT(relativeDifference(made.depth_hessian, expected.depth_hessian), 1e-12);
    EXPECT_LT(relativeDifference(made.pose_gradient, expected.pose_gradient), 1e-10);
    EXPECT_LT(relativeDifference(made.depth_gradient, expected.depth_gradient), 1e-10);
    EXPECT_NEAR(made.weighted_error / expected.weighted_error, 1, 1e-12);
    EXPECT_EQ(made.rows, expected.rows);
    EXPECT_NEAR(*reprojectionCost(scene.start, {}, scene.camera, options) / cost, 1, 1e-12);
  }
}

TEST(ReprojectionEquations, LeaveOutCornersThatAreNotKept) {
  const SyntheticMap scene = someMap();
  const PoseRows rows(scene.start);
  std::vector<char> kept(scene.start.corners.size(), 1);
  kept[7] = 0;
  const ReprojectionEquations made =
      linearize(scene.start, kept, rows, scene.camera, optionsWith(RobustLoss::kCauchy));
  EXPECT_EQ(made.depth_hessian[7], 0);
  EXPECT_EQ(made.coupling.col(7).norm(), 0);
  EXPECT_GT(made.depth_hessian[8], 0);
}

TEST(ReprojectionEquations, HaveNoCostWhereAPointIsBehindACamera) {
  SyntheticMap scene = someMap();
  scene.start.frames[2].T_cam_ref = SE3(Eigen::Matrix3d::Identity(), {0, 0, -10});
  const GeometricOptions options = optionsWith(RobustLoss::kHuber);
  EXPECT_FALSE(reprojectionCost(scene.start, {}, scene.camera, options));
  // The others still count.
  const PoseRows rows(scene.start);
  EXPECT_GT(linearize(scene.start, {}, rows, scene.camera, options).rows, 500);
}

TEST(ReprojectionEquations, AreBitIdenticalForAnyNumberOfThreads) {
  const SyntheticMap scene = someMap();
  const PoseRows rows(scene.start);
  const auto make = [&] {
    return linearize(scene.start, {}, rows, scene.camera, optionsWith(RobustLoss::kCauchy));
  };
  const ReprojectionEquations one = TaskArena(1).run(make);
  const ReprojectionEquations two = TaskArena(2).run(make);
  EXPECT_EQ(one.pose_hessian, two.pose_hessian);
  EXPECT_EQ(one.coupling, two.coupling);
  EXPECT_EQ(one.pose_gradient, two.pose_gradient);
}

}  // namespace
}  // namespace dsorb::init_orb
