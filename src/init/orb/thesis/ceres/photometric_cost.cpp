// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/thesis/ceres/photometric_cost.h"

#include "init/orb/thesis/ceres/reprojection_cost.h"

#include <cmath>

namespace dsorb::init_orb {
namespace {

template <int kColumns>
using RowMajor8 = Eigen::
    Matrix<double, kPatternSize, kColumns, kColumns == 1 ? Eigen::ColMajor : Eigen::RowMajor>;

}  // namespace

PhotometricCost::PhotometricCost(const HostPatch& patch, const Setting& setting)
    : patch_(patch), setting_(setting) {
  set_num_residuals(kPatternSize);
  mutable_parameter_block_sizes()->push_back(7);
  if (setting.brightness == PhotometricBrightness::kAffine) {
    mutable_parameter_block_sizes()->push_back(2);
  }
  mutable_parameter_block_sizes()->push_back(1);
}

bool PhotometricCost::Evaluate(double const* const* parameters,
                               double* residuals,
                               double** jacobians) const {
  const bool affine = setting_.brightness == PhotometricBrightness::kAffine;
  const std::size_t depth_block = affine ? 2 : 1;
  PatchTarget target = setting_.target;
  target.T_cam_ref = fromBlock(parameters[0]);
  if (affine) {
    target.transfer = brightnessTransfer(
        {}, setting_.reference_exposure, {parameters[1][0], parameters[1][1]}, setting_.exposure);
  }
  const PatchResidual patch =
      evaluatePatch(patch_, target, parameters[depth_block][0], setting_.brightness);
  // Derivative of each residual by the difference of grey levels.
  PatchVector factor;
  for (int j = 0; j < kPatternSize; ++j) {
    const double r = patch.residual[j];
    const double root_weight =
        std::sqrt(static_cast<double>(patch_.weight[static_cast<std::size_t>(j)]));
    const double threshold = setting_.huber_threshold;
    const bool valid = std::isfinite(r);
    const double robust = std::abs(r) <= threshold
                              ? std::abs(r)
                              : std::sqrt(2 * threshold * std::abs(r) - threshold * threshold);
    residuals[j] = valid ? root_weight * std::copysign(robust, r) : 0;
    factor[j] = !valid                     ? 0
                : std::abs(r) <= threshold ? root_weight
                                           : root_weight * threshold / robust;
  }
  if (jacobians == nullptr) return true;
  // Pixels that are not valid have no gradient either, but may spoil a mean.
  const auto fill = [&](auto jacobian, const auto& J) {
    jacobian = factor.asDiagonal() * J;
    jacobian = jacobian.unaryExpr([](double v) { return std::isfinite(v) ? v : 0.0; }).eval();
  };
  if (jacobians[0] != nullptr) {
    Eigen::Matrix<double, 6, 7, Eigen::RowMajor> minus;
    PoseManifold().MinusJacobian(parameters[0], minus.data());
    fill(Eigen::Map<RowMajor8<7>>(jacobians[0]), (patch.J_pose * minus).eval());
  }
  if (affine && jacobians[1] != nullptr) {
    fill(Eigen::Map<RowMajor8<2>>(jacobians[1]), patch.J_affine);
  }
  if (jacobians[depth_block] != nullptr) {
    fill(Eigen::Map<RowMajor8<1>>(jacobians[depth_block]), patch.J_inverse_depth);
  }
  return true;
}

}  // namespace dsorb::init_orb
