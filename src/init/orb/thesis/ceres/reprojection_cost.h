// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/geometry/se3.h"

#include "init/orb/thesis/ceres/manifold.h"

#include <ceres/sized_cost_function.h>

#include <array>

namespace dsorb::init_orb {

/// Pose as Ceres sees it: quaternion (x, y, z, w), translation.
using PoseBlock = std::array<double, 7>;

[[nodiscard]] PoseBlock toBlock(const SE3& pose);
[[nodiscard]] SE3 fromBlock(const double* block);

/// Poses with the increment exp([translation; rotation]) from the left.
/// @source Jacobians derived from dq = (omega / 2, 0) q and dt = upsilon + omega x t; checked
///         numerically in geometric_adjustment_test
class PoseManifold final : public CeresManifold {
 public:
  [[nodiscard]] int AmbientSize() const override { return 7; }
  [[nodiscard]] int TangentSize() const override { return 6; }
  bool Plus(const double* x, const double* delta, double* x_plus_delta) const override;
  bool PlusJacobian(const double* x, double* jacobian) const override;
  bool Minus(const double* y, const double* x, double* y_minus_x) const override;
  bool MinusJacobian(const double* x, double* jacobian) const override;
};

/// Whitened reprojection error of one corner in one frame; parameters: pose, inverse depth.
/// Evaluation fails when the point is not in front of the camera.
class ReprojectionCost final : public ceres::SizedCostFunction<2, 7, 1> {
 public:
  /// @param ray       of the corner in the reference, z = 1
  /// @param pixel     observed [px]
  /// @param whitening inverse square root of the pixel's covariance [1/px]
  ReprojectionCost(const PinholeCamera& camera,
                   const Eigen::Vector3d& ray,
                   const Eigen::Vector2d& pixel,
                   const Eigen::Matrix2d& whitening)
      : camera_(&camera), ray_(ray), pixel_(pixel), whitening_(whitening) {}

  bool Evaluate(double const* const* parameters,
                double* residuals,
                double** jacobians) const override;

 private:
  const PinholeCamera* camera_;
  Eigen::Vector3d ray_;
  Eigen::Vector2d pixel_;
  Eigen::Matrix2d whitening_;
};

}  // namespace dsorb::init_orb
