// SPDX-License-Identifier: BSD-3-Clause
#include "base/parallel.h"
#include "support/coarse_images.h"
#include "support/jacobian_check.h"

#include <gmock/gmock.h>

#include <utility>
#include <vector>

namespace dsorb::init_coarse {
namespace {

/// Constant gradient: bilinear interpolation and central differences are exact.
Pyramid ramp(float dx, float dy) {
  std::vector<float> pixels;
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      pixels.push_back(100.0F + dx * static_cast<float>(x) + dy * static_cast<float>(y));
    }
  }
  return Pyramid(ImageView(pixels.data(), kWidth, kHeight));
}

class JacobianTest : public testing::TestWithParam<std::pair<float, float>> {
 protected:
  JacobianTest()
      : image_(ramp(GetParam().first, GetParam().second)),
        view_{&image_.level(0), kCamera},
        points_(makePointLevel(image_.level(0), gridPixels(9))) {
    scatterDepths(points_, 3);
    matchReference(image_.level(0), alignment_, points_);
  }
  Pyramid image_;
  LevelView view_;
  PointLevel points_;
  Alignment alignment_ = someMotion();
  LinearSystem<float> system_;
};

// Where residuals are zero, the derivative of J^T r is J^T J: this checks every Jacobian entry.
TEST_P(JacobianTest, PoseAndBrightnessMatchNumericOnes) {
  const LevelSums at = evaluateLevel(view_, alignment_, {}, points_, system_);
  ASSERT_EQ(at.good, points_.size());
  const Eigen::MatrixXd numeric = numericJacobian(
      [&](const Eigen::VectorXd& step) -> Eigen::VectorXd {
        LinearSystem<float> moved;
        evaluateLevel(view_, movedBy(alignment_, step), {}, points_, moved);
        return moved.b;
      },
      8,
      3e-3);
  // Measured 1.2e-4 (float arithmetic); margin x4.
  for (int i = 0; i < 8; ++i) {
    EXPECT_LT(relativeDifference(system_.H.col(i), numeric.col(i)), 5e-4) << "parameter " << i;
  }
}

TEST_P(JacobianTest, DepthMatchesNumericOnes) {
  evaluateLevel(view_, alignment_, {}, points_, system_);
  const std::vector<float> curvature = points_.trial_curvature;
  const std::vector<float> depths = points_.trial_inverse_depth;
  const auto gradientAt = [&](float step) {
    for (std::size_t i = 0; i < depths.size(); ++i) {
      points_.trial_inverse_depth[i] = depths[i] + step;
    }
    LinearSystem<float> terms;
    evaluateLevel(view_, alignment_, {}, points_, terms);
    return terms.depth_gradient;
  };
  constexpr float kStep = 0.05F;
  const std::vector<float> plus = gradientAt(kStep);
  const std::vector<float> minus = gradientAt(-kStep);
  double worst = 0;
  double largest = 0;
  for (std::size_t i = 0; i < depths.size(); ++i) {
    EXPECT_FLOAT_EQ(system_.depth_hessian[i], 1.0F + curvature[i]);
    worst = std::max(
        worst, std::abs(static_cast<double>((plus[i] - minus[i]) / (2 * kStep) - curvature[i])));
    largest = std::max(largest, static_cast<double>(curvature[i]));
  }
  // Measured 5e-5 of the largest curvature; margin x4.
  EXPECT_LT(worst / largest, 2e-4);
}

TEST_P(JacobianTest, CouplingMatchesNumericOnes) {
  evaluateLevel(view_, alignment_, {}, points_, system_);
  const int n = points_.size();
  const Eigen::MatrixXd numeric = numericJacobian(
      [&](const Eigen::VectorXd& step) -> Eigen::VectorXd {
        LinearSystem<float> terms;
        evaluateLevel(view_, movedBy(alignment_, step), {}, points_, terms);
        return Eigen::Map<const Eigen::VectorXf>(terms.depth_gradient.data(), n).cast<double>();
      },
      8,
      3e-3);
  const Eigen::MatrixXd analytic =
      Eigen::Map<const Eigen::Matrix<float, 8, Eigen::Dynamic>>(system_.coupling.data(), 8, n)
          .cast<double>()
          .transpose();
  // Measured 3.8e-4; margin x4.
  for (int i = 0; i < 8; ++i) {
    EXPECT_LT(relativeDifference(analytic.col(i), numeric.col(i)), 1.5e-3) << "parameter " << i;
  }
}

INSTANTIATE_TEST_SUITE_P(Gradients,
                         JacobianTest,
                         testing::Values(std::pair{0.5F, 0.1F},
                                         std::pair{-0.1F, 0.6F},
                                         std::pair{0.4F, -0.3F}));

TEST(CoarseResidual, ProjectionOutsideAndInvalidPixelsMakeAPointBad) {
  const Pyramid image = texturedPyramid(0);
  PointLevel points = makePointLevel(image.level(0), {{10, 60, 1}, {80, 60, 1}, {149, 60, 1}});
  points.energy = {5, 6, 7};
  Alignment alignment;
  alignment.T_cur_ref.setTranslation({-0.15, 0, 0});  // 19.5 px to the left
  LinearSystem<float> system;
  const LevelSums sums = evaluateLevel({&image.level(0), kCamera}, alignment, {}, points, system);
  EXPECT_THAT(points.trial_good, testing::ElementsAre(0, 1, 1));
  EXPECT_FLOAT_EQ(points.trial_energy[0], 5);
  EXPECT_DOUBLE_EQ(sums.energy, sums.good_energy + 5);
  points.trial_inverse_depth[1] = NAN;
  evaluateLevel({&image.level(0), kCamera}, alignment, {}, points, system);
  EXPECT_EQ(points.trial_good[1], 0);
}

TEST(CoarseResidual, SameBitsForAnyNumberOfThreads) {
  const Pyramid image = texturedPyramid(1.5);
  std::vector<LinearSystem<float>> systems;
  std::vector<double> energies;
  for (const int threads : {1, 2, 4}) {
    PointLevel points = makePointLevel(image.level(0), gridPixels(2));
    TaskArena arena(threads);
    systems.emplace_back();
    energies.push_back(arena.run([&] {
      const LevelView view{&image.level(0), kCamera};
      return evaluateLevel(view, someMotion(), {}, points, systems.back()).energy;
    }));
  }
  for (std::size_t i = 0; i < systems.size(); ++i) {
    EXPECT_EQ(systems[i].H, systems.front().H);
    EXPECT_EQ(systems[i].b, systems.front().b);
    EXPECT_EQ(systems[i].coupling, systems.front().coupling);
    EXPECT_EQ(systems[i].depth_gradient, systems.front().depth_gradient);
    EXPECT_EQ(energies[i], energies.front());
  }
}

}  // namespace
}  // namespace dsorb::init_coarse
