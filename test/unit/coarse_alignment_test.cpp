// SPDX-License-Identifier: BSD-3-Clause
#include "init/coarse/coarse_alignment.h"

#include "support/coarse_images.h"
#include "support/jacobian_check.h"
#include "support/reference_coarse_options.h"

#include <Eigen/LU>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

namespace dsorb::init_coarse {
namespace {

TEST(CoarseAlignment, SchurSolveEqualsTheDenseSolve) {
  const Pyramid image = texturedPyramid(0.02);
  const LevelView view{&image.level(0), kCamera};
  PointLevel points = makePointLevel(image.level(0), gridPixels(13));
  scatterDepths(points, 5);
  const Alignment alignment = someMotion();
  matchReference(texturedPyramid(0).level(0), alignment, points);
  LevelAligner aligner{CoarseOptions{}};
  const LevelState state = aligner.evaluate(view, Unknowns::kAll, points, alignment);
  ASSERT_TRUE(state.prior.capped);
  const LinearSystem<float> system = aligner.evaluated();
  aligner.accept(points);

  constexpr double kDamping = 0.1;
  const int n = points.size();
  Eigen::MatrixXd A = Eigen::MatrixXd::Zero(8 + n, 8 + n);
  Eigen::VectorXd g(8 + n);
  A.topLeftCorner<8, 8>() = system.H;
  g.head<8>() = system.b;
  for (int i = 0; i < n; ++i) {
    const auto point = static_cast<std::size_t>(i);
    A.col(8 + i).head<8>() = system.couplingOf(point).cast<double>();
    A.row(8 + i).head<8>() = A.col(8 + i).head<8>().transpose();
    A(8 + i, 8 + i) = static_cast<double>(system.depth_hessian[point]);
    g[8 + i] = static_cast<double>(system.depth_gradient[point]);
  }
  A.diagonal() *= 1.0 + kDamping;
  const Eigen::VectorXd dense = -A.fullPivLu().solve(g);
  const Vector8d step = aligner.solve(Unknowns::kAll, kDamping);
  // Float sums: measured 3.1e-6 for the pose, 6.1e-8 for the depths; margin x5.
  EXPECT_LT((step - dense.head<8>()).norm() / dense.head<8>().norm(), 1.5e-5);
  points.inverse_depth = points.trial_inverse_depth;
  aligner.stepDepths(step, points);
  for (int i = 0; i < n; ++i) {
    const auto point = static_cast<std::size_t>(i);
    const double limit = 0.25 * static_cast<double>(points.max_step[point]);
    EXPECT_NEAR(points.trial_inverse_depth[point] - points.inverse_depth[point],
                std::clamp(dense[8 + i], -limit, limit),
                3e-7);
  }
}

/// Prior alone: a flat image explains everything.
class PriorTest : public testing::Test {
 protected:
  PriorTest() : image_(texturedPyramid(0, 100)) {
    points_ = makePointLevel(image_.level(0), gridPixels(10));
    alignment_.T_cur_ref = SE3(so3Exp({0.02, -0.03, 0.01}), {0.004, -0.003, 0.002});
  }
  LevelState evaluate(const Alignment& alignment, const CoarseOptions& options) {
    LevelAligner aligner(options);
    const LevelState state =
        aligner.evaluate({&image_.level(0), kCamera}, Unknowns::kAll, points_, alignment);
    gradient_ = 2 * aligner.evaluated().b;
    return state;
  }
  Pyramid image_;
  PointLevel points_;
  Alignment alignment_;
  Vector8d gradient_;  ///< of the energy last evaluated
};

TEST_F(PriorTest, EnergyIsConsistentWithItsGradient) {
  const CoarseOptions options;
  points_.trial_inverse_depth[3] = 1.01F;
  const LevelState state = evaluate(alignment_, options);
  ASSERT_FALSE(state.prior.capped);
  const Vector8d analytic = gradient_;
  const Eigen::MatrixXd gradient = numericJacobian(
      [&](const Eigen::VectorXd& xi) -> Eigen::VectorXd {
        Eigen::VectorXd step = Eigen::VectorXd::Zero(8);
        step.head<6>() = xi;
        return Eigen::VectorXd::Constant(1, evaluate(movedBy(alignment_, step), options).energy());
      },
      6,
      1e-5);
  // Measured 1.0e-6 (central differences); margin x10.
  EXPECT_LT(relativeDifference(analytic.head<6>().transpose(), gradient), 1e-5);

  points_.trial_inverse_depth[3] = 1.011F;
  const double plus = evaluate(alignment_, options).energy();
  points_.trial_inverse_depth[3] = 1.009F;
  const double minus = evaluate(alignment_, options).energy();
  EXPECT_NEAR((plus - minus) / 0.002, 2 * state.prior.weight * 0.01, 1);
}

TEST(CoarseAlignment, BalancedEnergyIsConsistentWithItsGradient) {
  const Pyramid image = texturedPyramid(1.5);
  PointLevel points = makePointLevel(image.level(0), gridPixels(9));
  matchReference(texturedPyramid(0).level(0), {}, points);
  const LevelView view{&image.level(0), kCamera};
  Alignment alignment;
  alignment.log_gain = 0.2;
  alignment.exposure_log_gain = 0.05;
  alignment.balanced = true;
  LinearSystem<float> at;
  ASSERT_EQ(evaluateLevel(view, alignment, {}, points, at).good, points.size());
  const Eigen::MatrixXd gradient = numericJacobian(
      [&](const Eigen::VectorXd& xi) -> Eigen::VectorXd {
        LinearSystem<float> system;
        return Eigen::VectorXd::Constant(
            1, evaluateLevel(view, movedBy(alignment, xi), {}, points, system).energy);
      },
      8,
      3e-3);
  EXPECT_NEAR(gradient(0, 6) / (2 * at.b[6]), 1, 1e-3);
  EXPECT_NEAR(gradient(0, 7) / (2 * at.b[7]), 1, 1e-3);
}

TEST(CoarseAlignment, ContrastStaysWhereImagesDoNotMatch) {
  // Image and reference differ by a shift the rotation may not follow: gain and offset alone.
  const Pyramid image = texturedPyramid(9);
  std::vector<double> log_gains;
  for (const bool balanced : {true, false}) {
    PointLevel points = makePointLevel(image.level(0), gridPixels(5));
    matchReference(texturedPyramid(0).level(0), {}, points);
    LevelAligner aligner{CoarseOptions{}};
    Alignment alignment;
    alignment.balanced = balanced;
    for (int i = 0; i < 20; ++i) {
      aligner.evaluate({&image.level(0), kCamera}, Unknowns::kPose, points, alignment);
      const LinearSystem<float>& system = aligner.evaluated();
      const Eigen::Vector2d step =
          system.H.bottomRightCorner<2, 2>().ldlt().solve(system.b.tail<2>());
      alignment.log_gain -= step[0];
      alignment.offset -= step[1];
    }
    log_gains.push_back(alignment.log_gain);
  }
  EXPECT_LT(std::abs(log_gains[0]), 0.1) << log_gains[0];
  EXPECT_LT(log_gains[1], -0.4) << log_gains[1];
}

TEST_F(PriorTest, PublishedEnergyLacksTheDepths) {
  const CoarseOptions options = referenceCoarseOptions();
  const double before = evaluate(alignment_, options).energy();
  points_.trial_inverse_depth[3] = 1.5F;
  EXPECT_EQ(evaluate(alignment_, options).energy(), before);
}

TEST_F(PriorTest, LeavesTheCapAtOneSixtieth) {
  for (const CoarseOptions& options : {CoarseOptions{}, referenceCoarseOptions()}) {
    Alignment alignment;
    alignment.T_cur_ref.setTranslation({0.0166, 0, 0});
    EXPECT_FALSE(evaluate(alignment, options).prior.capped);
    alignment.T_cur_ref.setTranslation({0.0167, 0, 0});
    const LevelState state = evaluate(alignment, options);
    EXPECT_TRUE(state.prior.capped);
    EXPECT_DOUBLE_EQ(state.prior.energy, 6.25 * points_.size());
  }
}

TEST_F(PriorTest, StaysReleasedOnceLeft) {
  Alignment alignment;
  alignment.snapped = true;
  EXPECT_TRUE(evaluate(alignment, CoarseOptions{}).prior.capped);
  EXPECT_FALSE(evaluate(alignment, referenceCoarseOptions()).prior.capped);
}

TEST(CoarseAlignment, IdenticalImagesKeepEverythingInPlace) {
  const Pyramid image = texturedPyramid(0);
  PointLevel points = makePointLevel(image.level(0), gridPixels(5));
  for (const CoarseOptions& options : {CoarseOptions{}, referenceCoarseOptions()}) {
    LevelAligner aligner(options);
    Alignment alignment;
    const LevelReport report =
        aligner.align({&image.level(0), kCamera}, 50, Unknowns::kAll, points, alignment);
    EXPECT_FALSE(alignment.snapped);
    EXPECT_LT(alignment.T_cur_ref.log().norm(), 1e-6);
    EXPECT_NEAR(report.state.energy(), 0, 1e-3);
    EXPECT_EQ(report.inlierShare(), 1);
  }
}

TEST(CoarseAlignment, FindsARotation) {
  // Image and points are those of one camera turned by a known angle; the depths do not matter.
  const SE3 T_cur_ref(so3Exp({0.004, 0.012, -0.01}), Eigen::Vector3d::Zero());
  const Pyramid image = texturedPyramid(0);
  PointLevel points = makePointLevel(image.level(0), gridPixels(5));
  Alignment truth;
  truth.T_cur_ref = T_cur_ref;
  matchReference(image.level(0), truth, points);
  for (const Unknowns unknowns : {Unknowns::kRotation, Unknowns::kAll}) {
    LevelAligner aligner{CoarseOptions{}};
    Alignment alignment;
    aligner.align({&image.level(0), kCamera}, 50, unknowns, points, alignment);
    EXPECT_FALSE(alignment.snapped);
    // Measured 6.9e-6; margin x5.
    EXPECT_LT((T_cur_ref.inverse() * alignment.T_cur_ref).log().norm(), 3.5e-5);
  }
}

}  // namespace
}  // namespace dsorb::init_coarse
