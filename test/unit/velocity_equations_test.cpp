// SPDX-License-Identifier: BSD-3-Clause
#include "window/normal_equations.h"

#include <gtest/gtest.h>

namespace dsorb::window {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr Eigen::Index kHost = kCameraDim;
constexpr Eigen::Index kState = kFrameDim + kVelocityDim;
constexpr Eigen::Index kTarget = kCameraDim + kState;
constexpr Eigen::Index kSize = kCameraDim + 2 * kState;

/// A pair with any factors between relative and absolute states.
PairGeometry somePair() {
  PairGeometry pair{};
  pair.to_host.setZero();
  pair.to_host.topLeftCorner<6, 6>().setRandom();
  pair.to_host.bottomRightCorner<2, 2>().diagonal().setRandom();
  pair.to_target.setRandom();
  return pair;
}

ResidualGeometry someGeometry() {
  const Eigen::VectorXf values = Eigen::VectorXf::Random(2 * kRowLanes);
  ResidualGeometry geometry;
  for (std::size_t i = 0; i < kRowLanes; ++i) {
    const bool known = i < kPoseRows || (i >= kLaneCamera && i < kLaneCamera + kCameraDim);
    if (!known) continue;
    geometry.x[i] = values[static_cast<Eigen::Index>(i)];
    geometry.y[i] = values[static_cast<Eigen::Index>(i + kRowLanes)];
  }
  geometry.target_time = 0.4F;
  geometry.host_time = -0.3F;
  return geometry;
}

/// Derivatives of (x, y, a, b) by the whole state, built without sums.
MatrixXd wholeJacobian(const PairGeometry& pair, const ResidualGeometry& g) {
  MatrixXd relative = MatrixXd::Zero(4, kFrameDim);
  MatrixXd camera = MatrixXd::Zero(4, kCameraDim);
  for (Eigen::Index i = 0; i < kPoseRows; ++i) {
    relative(0, i) = static_cast<double>(g.x[i]);
    relative(1, i) = static_cast<double>(g.y[i]);
  }
  relative(2, 6) = relative(3, 7) = 1;
  for (Eigen::Index i = 0; i < kCameraDim; ++i) {
    camera(0, i) = static_cast<double>(g.x[static_cast<Eigen::Index>(kLaneCamera) + i]);
    camera(1, i) = static_cast<double>(g.y[static_cast<Eigen::Index>(kLaneCamera) + i]);
  }
  MatrixXd J(4, kSize);
  const MatrixXd host = relative * pair.to_host.transpose();
  const MatrixXd target = relative * pair.to_target.asDiagonal();
  J << camera, host, static_cast<double>(g.host_time) * host.leftCols<6>(), target,
      static_cast<double>(g.target_time) * target.leftCols<6>();
  return J;
}

TEST(VelocityEquations, AreThoseOfTheWholeJacobian) {
  std::srand(3);  // Eigen's Random
  const PairGeometry pair = somePair();
  VelocitySums sums{};
  MatrixXd H = MatrixXd::Zero(kSize, kSize);
  VectorXd b = VectorXd::Zero(kSize);
  for (int residual = 0; residual < 5; ++residual) {
    const ResidualGeometry g = someGeometry();
    // Eight pixels: derivatives by (x, y, a, b) and residual.
    const Eigen::Matrix<float, 8, 5> pixels = Eigen::Matrix<float, 8, 5>::Random();
    const Eigen::Matrix<float, 5, 5> products = pixels.transpose() * pixels;
    float x[kRowLanes] = {};
    float y[kRowLanes] = {};
    for (std::size_t i = 0; i < kRowLanes; ++i) {
      x[i] = products(0, 0) * g.x[i] + products(0, 1) * g.y[i];
      y[i] = products(1, 0) * g.x[i] + products(1, 1) * g.y[i];
    }
    for (const auto& [lane, column] :
         {std::pair(kLaneA, 2), std::pair(kLaneB, 3), std::pair(kLaneResidual, 4)}) {
      x[lane] = products(0, column);
      y[lane] = products(1, column);
    }
    accumulateVelocities(g, x, y, true, sums);
    const MatrixXd J = wholeJacobian(pair, g);
    H += J.transpose() * products.topLeftCorner<4, 4>().cast<double>() * J;
    b += J.transpose() * products.topRightCorner<4, 1>().cast<double>();
  }
  LinearSystem<float> system;
  system.reset(kSize, 0);
  addVelocities(sums, pair, {kHost, kTarget}, system);
  for (const Eigen::Index velocity : {kHost + kFrameDim, kTarget + kFrameDim}) {
    const MatrixXd rows = system.H.middleRows<kVelocityDim>(velocity);
    const MatrixXd expected = H.middleRows<kVelocityDim>(velocity);
    EXPECT_LT((rows - expected).norm(), 1e-5 * expected.norm());
    EXPECT_LT((system.H.middleCols<kVelocityDim>(velocity) - expected.transpose()).norm(),
              1e-5 * expected.norm());
    const VectorXd gradient = b.segment<kVelocityDim>(velocity);
    EXPECT_LT((system.b.segment<kVelocityDim>(velocity) - gradient).norm(), 1e-5 * gradient.norm());
  }
}

}  // namespace
}  // namespace dsorb::window
