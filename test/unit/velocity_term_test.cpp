// SPDX-License-Identifier: BSD-3-Clause
#include "support/jacobian_check.h"
#include "track/pose_alignment.h"

#include <gtest/gtest.h>

namespace dsorb::track {
namespace {

using Vector12d = Eigen::Matrix<double, 12, 1>;
using Matrix12d = Eigen::Matrix<double, 12, 12>;

/// A frame 30 ms after one, 70 ms after another.
RowsOfFrame someRows() {
  Vector6d first;
  Vector6d second;
  first << 0.01, -0.02, 0.005, 0.01, 0.004, -0.006;
  second << 0.03, -0.03, 0.01, 0.02, -0.008, -0.01;
  RowsOfFrame rows;
  rows.timestamp = 0.1;
  rows.recent = {{0.07, SE3::exp(first)}, {0.03, SE3::exp(second)}};
  rows.sigma << 0.1, 0.1, 0.1, 0.02, 0.02, 0.02;
  return rows;
}

TEST(VelocityTerm, GradientAndCurvatureAreThoseOfTheEnergy) {
  const RowsOfFrame rows = someRows();
  const VelocityTerm term(rows, 25);
  Vector6d velocity = rows.predict(SE3()).velocity;
  velocity += (Vector6d() << 0.1, -0.2, 0.3, 0.02, 0.05, -0.03).finished();
  const auto gradientAt = [&](const Eigen::VectorXd& d) {
    const auto energy = [&](const Eigen::VectorXd& e) {
      const Eigen::VectorXd sum = d + e;
      return Eigen::VectorXd::Constant(
          1, 0.5 * term.energy(SE3::exp(sum.head<6>()), velocity + sum.tail<6>()));
    };
    return Eigen::VectorXd(numericJacobian(energy, 12, 1e-5).transpose());
  };
  Matrix12d H = Matrix12d::Zero();
  Vector12d b = Vector12d::Zero();
  term.addTo(SE3(), velocity, H, b);
  const Eigen::MatrixXd gradient = gradientAt(Eigen::VectorXd::Zero(12));
  // Measured 1.5 %: the logarithm of a motion of a degree.
  EXPECT_LT(relativeDifference(b, gradient), 0.03);
  EXPECT_LT(relativeDifference(H, numericJacobian(gradientAt, 12, 1e-3)), 0.03);
}

TEST(VelocityTerm, FramesAtTheSameTimeCountOnce) {
  RowsOfFrame rows = someRows();
  Matrix12d once = Matrix12d::Zero();
  Matrix12d twice = Matrix12d::Zero();
  Vector12d b = Vector12d::Zero();
  VelocityTerm(rows, 1).addTo(SE3(), Vector6d::Zero(), once, b);
  rows.recent.insert(rows.recent.begin(), rows.recent.front());
  VelocityTerm(rows, 1).addTo(SE3(), Vector6d::Zero(), twice, b);
  EXPECT_EQ(once, twice);
}

}  // namespace
}  // namespace dsorb::track
