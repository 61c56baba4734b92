// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/bundle/robust_adjustment.h"

#include "published/bundle_adjustment.h"
#include "support/matchers.h"
#include "support/synthetic_map.h"

#include <Eigen/Core>
#include <ceres/sized_cost_function.h>
#include <gtest/gtest.h>

namespace dsorb::init_orb {
namespace {

Eigen::Matrix2d someWhitening() {
  return (Eigen::Matrix2d() << 1.2, 0, 0.3, 0.9).finished();
}

/// Whitened reprojection error of one corner in one frame.
class WhitenedCost final : public ceres::SizedCostFunction<2, 7, 1> {
 public:
  WhitenedCost(const InitialMap& map, const PinholeCamera& camera, const CornerObservation& seen)
      : camera_(camera), ray_(camera.unproject(map.corners[seen.corner].pixel)), seen_(seen) {}

  bool Evaluate(double const* const* parameters,
                double* residuals,
                double** jacobians) const override {
    const auto projection =
        projectHosted(camera_, published::fromBlock(parameters[0]), ray_, parameters[1][0]);
    if (!projection) return false;
    Eigen::Map<Eigen::Vector2d>(residuals, 2) = seen_.whitening * (projection->pixel - seen_.pixel);
    if (jacobians == nullptr) return true;
    if (jacobians[0] != nullptr) {
      Eigen::Map<Eigen::Matrix<double, 2, 7, Eigen::RowMajor>>(jacobians[0], 2, 7)
          << seen_.whitening * projection->J_pose,
          Eigen::Vector2d::Zero();
    }
    if (jacobians[1] != nullptr) {
      Eigen::Map<Eigen::Vector2d>(jacobians[1], 2) = seen_.whitening * projection->J_inverse_depth;
    }
    return true;
  }

 private:
  PinholeCamera camera_;
  Eigen::Vector3d ray_;
  CornerObservation seen_;
};

/// The referee.
bool solveWithCeres(InitialMap& map, const PinholeCamera& camera, const GeometricOptions& options) {
  std::vector<SE3> poses;
  for (const PosedFrame& frame : map.frames) poses.push_back(*frame.T_cam_ref);
  std::vector<double> inverse_depths;
  for (const Corner& corner : map.corners) inverse_depths.push_back(corner.inverse_depth);
  published::CeresAdjustment adjustment(poses, inverse_depths);
  ceres::LossFunction* loss =
      options.loss == RobustLoss::kHuber
          ? static_cast<ceres::LossFunction*>(new ceres::HuberLoss(options.loss_threshold))
          : new ceres::CauchyLoss(options.loss_threshold);
  for (const CornerObservation& seen : map.observations) {
    adjustment.add(new WhitenedCost(map, camera, seen), loss, seen.frame, seen.corner);
  }
  const auto solved = adjustment.solve(200, 1e-16);
  if (!solved) return false;
  for (std::size_t k = 1; k < poses.size(); ++k) map.frames[k].T_cam_ref = solved->poses[k];
  for (std::size_t i = 0; i < inverse_depths.size(); ++i) {
    map.corners[i].inverse_depth = solved->inverse_depths[i];
  }
  return true;
}

constexpr Stopping kExact{200, 1e-16};

class SolverAgainstCeres : public testing::TestWithParam<RobustLoss> {};

TEST_P(SolverAgainstCeres, FindsTheSameMinimum) {
  for (std::uint64_t seed = 40; seed < 45; ++seed) {
    SyntheticMap scene = makeSyntheticMap({200, 6, 0.5, 0.2}, seed);
    Random random(seed);
    for (CornerObservation& observation : scene.start.observations) {
      if (random.uniform() < 0.1) {  // beyond the loss's limit
        observation.pixel += Eigen::Vector2d{random.uniform(-30, 30), random.uniform(-30, 30)};
      }
      observation.whitening = someWhitening();
    }
    GeometricOptions options = huber();
    options.loss = GetParam();
    InitialMap by_ceres = scene.start;
    InitialMap by_schur = scene.start;
    ASSERT_TRUE(solveWithCeres(by_ceres, scene.camera, options));
    ASSERT_TRUE(solveGeometry(by_schur, scene.camera, options, kExact));
    ASSERT_TRUE(normalizeCornerScale(by_ceres) && normalizeCornerScale(by_schur));
    const double cost = reprojectionCost(by_ceres, scene.camera, options).value_or(0);
    EXPECT_NEAR(reprojectionCost(by_schur, scene.camera, options).value_or(1) / cost, 1, 1e-9);
    for (std::size_t k = 1; k < by_ceres.frames.size(); ++k) {
      EXPECT_THAT(*by_schur.frames[k].T_cam_ref, Se3Near(*by_ceres.frames[k].T_cam_ref, 1e-4, 1e-5))
          << k;
    }
    for (std::size_t i = 0; i < by_ceres.corners.size(); ++i) {
      EXPECT_NEAR(by_schur.corners[i].inverse_depth, by_ceres.corners[i].inverse_depth, 1e-5) << i;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(EveryLoss,
                         SolverAgainstCeres,
                         testing::Values(RobustLoss::kHuber, RobustLoss::kCauchy));

}  // namespace
}  // namespace dsorb::init_orb
