// SPDX-License-Identifier: BSD-3-Clause
#include "estimate/linear_system.h"

#include "base/parallel.h"
#include "base/random.h"
#include "estimate/levenberg_marquardt.h"
#include "estimate/marginals.h"
#include "support/jacobian_check.h"

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

namespace dsorb {
namespace {

constexpr Eigen::Index kSize = 14;        // no whole number of lanes
constexpr std::size_t kPoints = 150;      // no whole number of blocks
constexpr std::size_t kUnknownPoint = 5;  // has no part

/// A system and the same as one dense matrix, from random residuals that each see one point.
template <typename Scalar>
struct RandomSystem {
  LinearSystem<Scalar> system;
  Eigen::MatrixXd dense = Eigen::MatrixXd::Zero(kSize + kPoints, kSize + kPoints);
  Eigen::VectorXd right = Eigen::VectorXd::Zero(kSize + kPoints);

  RandomSystem() {
    Random random(1);
    for (std::size_t i = 0; i < kPoints; ++i) {
      for (int residual = 0; residual < 4 && i != kUnknownPoint; ++residual) {
        Eigen::VectorXd J = Eigen::VectorXd::Zero(kSize + kPoints);
        for (Eigen::Index k = 0; k < kSize; ++k) J[k] = random.gaussian();
        J[kSize + static_cast<Eigen::Index>(i)] = random.gaussian();
        dense += J * J.transpose();
        right += random.gaussian() * J;
      }
    }
    system.reset(kSize, kPoints);
    system.H = dense.topLeftCorner(kSize, kSize);
    system.b = right.head(kSize);
    for (std::size_t i = 0; i < kPoints; ++i) {
      const auto column = kSize + static_cast<Eigen::Index>(i);
      for (Eigen::Index k = 0; k < kSize; ++k) {
        system.coupling[i * system.stride + static_cast<std::size_t>(k)] =
            static_cast<Scalar>(dense(k, column));
      }
      system.depth_hessian[i] = static_cast<Scalar>(dense(column, column));
      system.depth_gradient[i] = static_cast<Scalar>(right[column]);
    }
  }
};

constexpr double kTolerance = 1e-12;

TEST(LinearSystem, SolutionEqualsThatOfTheDenseSystem) {
  const RandomSystem<double> random;
  for (const double damping : {0.0, 0.3}) {
    DampedSolver solver;
    const auto decrease = solver.solve(random.system, damping);
    ASSERT_TRUE(decrease);
    Eigen::MatrixXd dense = random.dense;
    dense.diagonal() *= 1 + damping;
    dense(kSize + kUnknownPoint, kSize + kUnknownPoint) = 1;
    const Eigen::VectorXd expected = -dense.ldlt().solve(random.right);
    const Eigen::VectorXd depths =
        Eigen::Map<const Eigen::VectorXd>(solver.depthStep().data(), kPoints);
    EXPECT_LT(relativeDifference(solver.step(), expected.head(kSize)), kTolerance);
    EXPECT_LT(relativeDifference(depths, expected.tail(kPoints)), kTolerance);
    EXPECT_EQ(depths[kUnknownPoint], 0);
    const double predicted =
        -random.right.dot(expected) - 0.5 * expected.dot(random.dense * expected);
    EXPECT_NEAR(*decrease / predicted, 1, kTolerance);
  }
}

TEST(LinearSystem, EliminationOfSinglePrecisionIsAsGood) {
  const RandomSystem<float> random;
  const RandomSystem<double> exact;
  Eigen::MatrixXd H = random.system.H;
  Eigen::VectorXd b = random.system.b;
  DepthElimination<float> elimination;
  elimination.damp(random.system, 0);
  elimination.eliminate(random.system, H, b);
  Eigen::MatrixXd H_exact = exact.system.H;
  Eigen::VectorXd b_exact = exact.system.b;
  DepthElimination<double> of_double;
  of_double.damp(exact.system, 0);
  of_double.eliminate(exact.system, H_exact, b_exact);
  EXPECT_LT(
      relativeDifference(H.triangularView<Eigen::Lower>(), H_exact.triangularView<Eigen::Lower>()),
      1e-5);
  EXPECT_LT(relativeDifference(b, b_exact), 1e-5);
}

TEST(LinearSystem, SolutionIsBitIdenticalForAnyNumberOfThreads) {
  const RandomSystem<double> random;
  const auto solve = [&] {
    DampedSolver solver;
    solver.solve(random.system, 0.1);
    return std::make_pair(solver.step(), solver.depthStep());
  };
  EXPECT_EQ(TaskArena(1).run(solve), TaskArena(2).run(solve));
}

/// Rosenbrock's valley as two residuals, 10 (y - x^2) and 1 - x.
struct Valley {
  Eigen::Vector2d state{-1.2, 1};
  Eigen::Vector2d trial;
  Eigen::Vector2d step;

  static Eigen::Vector2d residual(const Eigen::Vector2d& at) {
    return {10 * (at.y() - at.x() * at.x()), 1 - at.x()};
  }
  static double cost(const Eigen::Vector2d& at) { return 0.5 * residual(at).squaredNorm(); }

  std::optional<double> solve(double damping) {
    Eigen::Matrix2d J;
    J << -20 * state.x(), 10, -1, 0;
    Eigen::Matrix2d H = J.transpose() * J;
    const Eigen::Vector2d b = J.transpose() * residual(state);
    const Eigen::Vector2d diagonal = H.diagonal();
    H.diagonal() *= 1 + damping;
    step = -H.ldlt().solve(b);
    return 0.5 * step.dot(damping * diagonal.cwiseProduct(step) - b);
  }
  std::optional<double> tryStep() {
    trial = state + step;
    const double decrease = cost(state) - cost(trial);
    return decrease >= 0 ? std::optional(decrease) : std::nullopt;
  }
  bool accept(const DampedStep& tried) {
    state = trial;
    return *tried.decrease > 1e-20;
  }
  static bool reject(const DampedStep& /*tried*/) { return true; }
};

TEST(LevenbergMarquardt, FindsTheMinimumByEitherRule) {
  Valley valley;
  GainDamping gain;
  EXPECT_LT(minimize(valley, gain, 100), 60);
  EXPECT_LT((valley.state - Eigen::Vector2d(1, 1)).norm(), 1e-8);
  Valley other;
  FactorDamping factor{0.01, 0.5, 4};
  EXPECT_LT(minimize(other, factor, 100), 60);
  EXPECT_LT((other.state - Eigen::Vector2d(1, 1)).norm(), 1e-8);
}

TEST(LevenbergMarquardt, EndsAfterTooManyFailuresInARow) {
  struct Stuck : Valley {
    static std::optional<double> tryStep() { return std::nullopt; }
  };
  Stuck stuck;
  FactorDamping damping{0.01, 0.5, 4, 0, 0, 1e4, 2};
  EXPECT_EQ(minimize(stuck, damping, 100), 2);
  EXPECT_DOUBLE_EQ(damping.value, 0.16);
}

}  // namespace
}  // namespace dsorb
