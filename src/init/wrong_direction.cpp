// SPDX-License-Identifier: BSD-3-Clause
#include "init/wrong_direction.h"

#include "base/angles.h"
#include "geometry/symmetric_eigen.h"
#include "geometry/tangent_basis.h"

#include <cmath>

namespace dsorb {
namespace {

/// Degrees of freedom of the t-distribution of a direction's errors, whose tails are those of
/// starts on real sequences.
constexpr double kFreedom = 4;

}  // namespace

Eigen::Vector2d directionSigmasDeg(const PosedFrame& frame) {
  const Eigen::Vector3d& t = frame.T_cam_ref->translation();
  const Eigen::Matrix<double, 3, 2> basis = tangentBasis(t.normalized());
  const Eigen::Matrix2d covariance =
      basis.transpose() * frame.covariance->topLeftCorner<3, 3>() * basis / t.squaredNorm();
  const Eigen::VectorXd variances = symmetricEigen(covariance).values.cwiseMax(0);
  return kDegPerRad * variances.cwiseSqrt();
}

double tailProbability(const Eigen::Vector2d& sigmas_deg, double angle_deg) {
  // In polar coordinates of the whitened plane the radius has a closed tail, (1 + r^2 / f)^(-f/2).
  constexpr int kAngles = 16;  // of a quarter: the others are alike
  double sum = 0;
  for (int i = 0; i < kAngles; ++i) {
    const double angle = (i + 0.5) * M_PI / 2 / kAngles;
    const double length =
        std::hypot(std::cos(angle) * sigmas_deg[0], std::sin(angle) * sigmas_deg[1]);
    const double radius = angle_deg / length;
    sum += std::pow(1 + radius * radius / kFreedom, -kFreedom / 2);
  }
  return sum / kAngles;
}

double rivalProbability(double cost_ratio, double samples) {
  return 1 / (1 + std::pow(cost_ratio, samples));
}

}  // namespace dsorb
