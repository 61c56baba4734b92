// SPDX-License-Identifier: BSD-3-Clause
#include "init/coarse/coarse_alignment.h"

#include "dsorb/image/pyramid.h"

#include "base/parallel.h"
#include "base/random.h"
#include "image/interpolate.h"
#include "image/photometric.h"
#include "support/jacobian_check.h"

#include <Eigen/LU>
#include <gmock/gmock.h>

#include <cmath>
#include <vector>

namespace dsorb::init_coarse {
namespace {

constexpr int kWidth = 160;
constexpr int kHeight = 120;
const PinholeCamera kCamera{130, 125, 81.3, 58.7, kWidth, kHeight};

/// Smooth texture; wavelengths of 25 px and more, so that central differences are derivatives.
float texture(double x, double y) {
  return static_cast<float>(120 + 25 * std::sin(0.21 * x + 0.07 * y) +
                            20 * std::sin(0.23 * y - 0.05 * x + 1) + 15 * std::cos(0.13 * (x + y)));
}

Pyramid texturedPyramid(double shift, float flat = -1) {
  std::vector<float> pixels;
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) pixels.push_back(flat < 0 ? texture(x + shift, y) : flat);
  }
  return Pyramid(ImageView(pixels.data(), kWidth, kHeight));
}

std::vector<SelectedPixel> gridPixels(int step) {
  std::vector<SelectedPixel> pixels;
  for (int y = 20; y < kHeight - 20; y += step) {
    for (int x = 20; x < kWidth - 20; x += step) pixels.push_back({x, y, 1});
  }
  return pixels;
}

Alignment someMotion() {
  Alignment alignment;
  Vector6d xi;
  xi << 0.03, -0.02, 0.04, 0.01, -0.015, 0.02;
  alignment.T_new_ref = SE3::exp(xi);
  return alignment;
}

Alignment movedBy(const Alignment& alignment, const Eigen::VectorXd& step) {
  Alignment result = alignment;
  result.T_new_ref = SE3::exp(step.head<6>()) * alignment.T_new_ref;
  result.log_gain += step[6];
  result.offset += step[7];
  return result;
}

/// Makes the residuals of all points 0 at an alignment with gain 1 and offset 0.
void matchReference(const PyramidLevel& image, const Alignment& alignment, PointLevel& points) {
  for (std::size_t i = 0; i < points.x.size(); ++i) {
    for (std::size_t k = 0; k < kPatternSize; ++k) {
      const Eigen::Vector2d pixel(static_cast<double>(points.x[i]) + kPattern[k].x,
                                  static_cast<double>(points.y[i]) + kPattern[k].y);
      const Eigen::Vector3d p =
          alignment.T_new_ref.unitQuaternion() * kCamera.unproject(pixel) +
          static_cast<double>(points.trial_inverse_depth[i]) * alignment.T_new_ref.translation();
      const Eigen::Vector2f seen = kCamera.project(p).cast<float>();
      points.reference[i * kPatternSize + k] = interpolateIntensity(image, seen.x(), seen.y());
    }
  }
}

void scatterDepths(PointLevel& points, std::uint64_t seed) {
  Random random(seed);
  for (float& depth : points.trial_inverse_depth) {
    depth = static_cast<float>(random.uniform(0.5, 1.5));
  }
  points.inverse_depth = points.trial_inverse_depth;
}

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
  SchurTerms schur_;
};

// Where residuals are zero, the derivative of J^T r is J^T J: this checks every Jacobian entry.
TEST_P(JacobianTest, PoseAndBrightnessMatchNumericOnes) {
  const NormalEquations at = evaluateLevel(view_, alignment_, {}, points_, schur_);
  ASSERT_EQ(at.good, points_.size());
  const Eigen::MatrixXd numeric = numericJacobian(
      [&](const Eigen::VectorXd& step) -> Eigen::VectorXd {
        return evaluateLevel(view_, movedBy(alignment_, step), {}, points_, schur_).b;
      },
      8,
      3e-3);
  // Measured 1.2e-4 (float arithmetic); margin x4.
  for (int i = 0; i < 8; ++i) {
    EXPECT_LT(relativeDifference(at.H.col(i), numeric.col(i)), 5e-4) << "parameter " << i;
  }
}

TEST_P(JacobianTest, DepthMatchesNumericOnes) {
  evaluateLevel(view_, alignment_, {}, points_, schur_);
  const std::vector<float> curvature = points_.trial_curvature;
  const std::vector<float> depths = points_.trial_inverse_depth;
  const auto gradientAt = [&](float step) {
    for (std::size_t i = 0; i < depths.size(); ++i) {
      points_.trial_inverse_depth[i] = depths[i] + step;
    }
    SchurTerms terms;
    evaluateLevel(view_, alignment_, {}, points_, terms);
    return terms.gradient;
  };
  constexpr float kStep = 0.05F;
  const std::vector<float> plus = gradientAt(kStep);
  const std::vector<float> minus = gradientAt(-kStep);
  double worst = 0;
  double largest = 0;
  for (std::size_t i = 0; i < depths.size(); ++i) {
    EXPECT_FLOAT_EQ(schur_.inverse_curvature[i], 1.0F / (1.0F + curvature[i]));
    worst = std::max(
        worst, std::abs(static_cast<double>((plus[i] - minus[i]) / (2 * kStep) - curvature[i])));
    largest = std::max(largest, static_cast<double>(curvature[i]));
  }
  // Measured 5e-5 of the largest curvature; margin x4.
  EXPECT_LT(worst / largest, 2e-4);
}

TEST_P(JacobianTest, CouplingMatchesNumericOnes) {
  evaluateLevel(view_, alignment_, {}, points_, schur_);
  const int n = points_.size();
  const Eigen::MatrixXd numeric = numericJacobian(
      [&](const Eigen::VectorXd& step) -> Eigen::VectorXd {
        SchurTerms terms;
        evaluateLevel(view_, movedBy(alignment_, step), {}, points_, terms);
        return Eigen::Map<const Eigen::VectorXf>(terms.gradient.data(), n).cast<double>();
      },
      8,
      3e-3);
  const Eigen::MatrixXd analytic =
      Eigen::Map<const Eigen::Matrix<float, 8, Eigen::Dynamic>>(schur_.coupling.data(), 8, n)
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
  alignment.T_new_ref.setTranslation({-0.15, 0, 0});  // 19.5 px to the left
  SchurTerms schur;
  const NormalEquations sums =
      evaluateLevel({&image.level(0), kCamera}, alignment, {}, points, schur);
  EXPECT_THAT(points.trial_good, testing::ElementsAre(0, 1, 1));
  EXPECT_FLOAT_EQ(points.trial_energy[0], 5);
  EXPECT_DOUBLE_EQ(sums.energy, sums.good_energy + 5);
  points.trial_inverse_depth[1] = NAN;
  evaluateLevel({&image.level(0), kCamera}, alignment, {}, points, schur);
  EXPECT_EQ(points.trial_good[1], 0);
}

TEST(CoarseResidual, SameBitsForAnyNumberOfThreads) {
  const Pyramid image = texturedPyramid(1.5);
  std::vector<NormalEquations> sums;
  for (const int threads : {1, 2, 4}) {
    PointLevel points = makePointLevel(image.level(0), gridPixels(2));
    SchurTerms schur;
    TaskArena arena(threads);
    sums.push_back(arena.run([&] {
      return evaluateLevel({&image.level(0), kCamera}, someMotion(), {}, points, schur);
    }));
  }
  for (const NormalEquations& other : sums) {
    EXPECT_EQ(other.H, sums.front().H);
    EXPECT_EQ(other.b_schur, sums.front().b_schur);
    EXPECT_EQ(other.energy, sums.front().energy);
  }
}

TEST(CoarseAlignment, SchurSolveEqualsTheDenseSolve) {
  const Pyramid image = texturedPyramid(0.02);
  const LevelView view{&image.level(0), kCamera};
  PointLevel points = makePointLevel(image.level(0), gridPixels(13));
  scatterDepths(points, 5);
  const Alignment alignment = someMotion();
  matchReference(texturedPyramid(0).level(0), alignment, points);
  LevelAligner aligner{CoarseOptions{}};
  const LevelState state = aligner.evaluate(view, Unknowns::kAll, points, alignment);
  aligner.accept(points);
  SchurTerms terms;  // the coupling of the capped prior, toward the smoothed depth 1
  ASSERT_TRUE(state.prior.capped);
  evaluateLevel(view, alignment, {0, 1}, points, terms);

  constexpr double kDamping = 0.1;
  const int n = points.size();
  Eigen::MatrixXd A = Eigen::MatrixXd::Zero(8 + n, 8 + n);
  Eigen::VectorXd g(8 + n);
  A.topLeftCorner<8, 8>() = state.equations.H;
  g.head<8>() = state.equations.b;
  for (int i = 0; i < n; ++i) {
    const auto point = static_cast<std::size_t>(i);
    for (int k = 0; k < 8; ++k) {
      A(k, 8 + i) = A(8 + i, k) =
          static_cast<double>(terms.coupling[point * 8 + static_cast<std::size_t>(k)]);
    }
    A(8 + i, 8 + i) = 1.0 / static_cast<double>(terms.inverse_curvature[point]);
    g[8 + i] = static_cast<double>(terms.gradient[point]);
  }
  A.diagonal() *= 1.0 + kDamping;
  const Eigen::VectorXd dense = -A.fullPivLu().solve(g);
  const Vector8d step = aligner.solve(state, Unknowns::kAll, kDamping);
  // Float sums: measured 3.1e-6 for the pose, 6.1e-8 for the depths; margin x5.
  EXPECT_LT((step - dense.head<8>()).norm() / dense.head<8>().norm(), 1.5e-5);
  points.inverse_depth = points.trial_inverse_depth;
  aligner.stepDepths(step, kDamping, points);
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
    alignment_.T_new_ref = SE3(so3Exp({0.02, -0.03, 0.01}), {0.004, -0.003, 0.002});
  }
  LevelState evaluate(const Alignment& alignment, const CoarseOptions& options) {
    LevelAligner aligner(options);
    return aligner.evaluate({&image_.level(0), kCamera}, Unknowns::kAll, points_, alignment);
  }
  Pyramid image_;
  PointLevel points_;
  Alignment alignment_;
};

TEST_F(PriorTest, EnergyIsConsistentWithItsGradient) {
  const CoarseOptions options;
  points_.trial_inverse_depth[3] = 1.01F;
  const LevelState state = evaluate(alignment_, options);
  ASSERT_FALSE(state.prior.capped);
  const Eigen::MatrixXd gradient = numericJacobian(
      [&](const Eigen::VectorXd& xi) -> Eigen::VectorXd {
        Eigen::VectorXd step = Eigen::VectorXd::Zero(8);
        step.head<6>() = xi;
        return Eigen::VectorXd::Constant(1, evaluate(movedBy(alignment_, step), options).energy());
      },
      6,
      1e-5);
  // Measured 1.0e-6 (central differences); margin x10.
  EXPECT_LT(relativeDifference(2 * state.equations.b.head<6>().transpose(), gradient), 1e-5);

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
  SchurTerms schur;
  const NormalEquations at = evaluateLevel(view, alignment, {}, points, schur);
  ASSERT_EQ(at.good, points.size());
  const Eigen::MatrixXd gradient = numericJacobian(
      [&](const Eigen::VectorXd& xi) -> Eigen::VectorXd {
        SchurTerms terms;
        return Eigen::VectorXd::Constant(
            1, evaluateLevel(view, movedBy(alignment, xi), {}, points, terms).energy);
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
      const LevelState state =
          aligner.evaluate({&image.level(0), kCamera}, Unknowns::kPose, points, alignment);
      const Eigen::Vector2d step =
          state.equations.H.bottomRightCorner<2, 2>().ldlt().solve(state.equations.b.tail<2>());
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
    alignment.T_new_ref.setTranslation({0.0166, 0, 0});
    EXPECT_FALSE(evaluate(alignment, options).prior.capped);
    alignment.T_new_ref.setTranslation({0.0167, 0, 0});
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
    EXPECT_LT(alignment.T_new_ref.log().norm(), 1e-6);
    EXPECT_NEAR(report.state.energy(), 0, 1e-3);
    EXPECT_EQ(report.inlierShare(), 1);
  }
}

TEST(CoarseAlignment, FindsARotation) {
  // Image and points are those of one camera turned by a known angle; the depths do not matter.
  const SE3 T_new_ref(so3Exp({0.004, 0.012, -0.01}), Eigen::Vector3d::Zero());
  const Pyramid image = texturedPyramid(0);
  PointLevel points = makePointLevel(image.level(0), gridPixels(5));
  Alignment truth;
  truth.T_new_ref = T_new_ref;
  matchReference(image.level(0), truth, points);
  for (const Unknowns unknowns : {Unknowns::kRotation, Unknowns::kAll}) {
    LevelAligner aligner{CoarseOptions{}};
    Alignment alignment;
    aligner.align({&image.level(0), kCamera}, 50, unknowns, points, alignment);
    EXPECT_FALSE(alignment.snapped);
    // Measured 6.9e-6; margin x5.
    EXPECT_LT((T_new_ref.inverse() * alignment.T_new_ref).log().norm(), 3.5e-5);
  }
}

}  // namespace
}  // namespace dsorb::init_coarse
