// SPDX-License-Identifier: BSD-3-Clause
#include "track/tracking_covariance.h"

#include "estimate/variance_factors.h"

#include <Eigen/Cholesky>
#include <Eigen/Core>

#include <algorithm>

namespace dsorb::track {
namespace {

/// Upper left 6 x 6 of the inverse, brightness being free.
template <int kSize>
std::optional<Matrix6d> inversePoseBlock(const Eigen::Matrix<double, kSize, kSize>& H) {
  using Square = Eigen::Matrix<double, kSize, kSize>;
  const Eigen::LLT<Square> cholesky(H);
  if (cholesky.info() != Eigen::Success) return std::nullopt;
  const Square inverse = cholesky.solve(Square::Identity());
  return Matrix6d(inverse.template topLeftCorner<6, 6>());
}

}  // namespace

double varianceOfResiduals(double rmse, double noise) {
  const double beyond_noise = std::max(0.0, rmse * rmse - noise * noise);
  return kResidualsPerNoise * (rmse * rmse - beyond_noise) + kResidualsPerMapError * beyond_noise;
}

std::optional<Matrix6d> trackingCovariance(const PoseEquations& equations,
                                           double variance,
                                           const SE3& T_cur_ref,
                                           BrightnessModel brightness) {
  const std::optional<Matrix6d> inverse =
      brightness == BrightnessModel::kPerfect
          ? inversePoseBlock<6>(equations.H.topLeftCorner<6, 6>())
          : inversePoseBlock<8>(equations.H);
  if (!inverse) return std::nullopt;
  Matrix6d covariance = variance * *inverse;
  const Eigen::Vector3d shared = variance_factors::kTrackedScale * T_cur_ref.translation();
  covariance.topLeftCorner<3, 3>() += shared * shared.transpose();
  covariance = (0.5 * (covariance + covariance.transpose())).eval();
  return covariance.allFinite() ? std::optional(covariance) : std::nullopt;
}

}  // namespace dsorb::track
