// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/thesis/ceres/photometric_cost.h"

#include "estimate/sampling.h"
#include "estimate/warp.h"
#include "init/orb/thesis/ceres/reprojection_cost.h"

#include <algorithm>
#include <cmath>

namespace dsorb::init_orb {
namespace {

template <int kColumns>
using RowMajor8 = Eigen::
    Matrix<double, kPatternSize, kColumns, kColumns == 1 ? Eigen::ColMajor : Eigen::RowMajor>;

/// Value at one pixel of the pattern and its derivatives, before brightness.
struct PatchPixel {
  double intensity = 0;
  Eigen::Matrix<double, 1, 6> J_pose = Eigen::Matrix<double, 1, 6>::Zero();
  double J_inverse_depth = 0;
  bool inside = false;
};

PatchPixel samplePixel(const PyramidLevel& image,
                       const Warp<double>& warp,
                       const Eigen::Vector2d& ray,
                       double rho) {
  WarpedPoint<double> point;
  warpPoint(warp, ray.x(), ray.y(), rho, point);
  SampleArea<double> area;
  sampleArea(image.width(), image.height(), area);
  SamplePosition<double> at;
  clampToArea(area, point, at);
  const Sample<double> sample = interpolate(image, at.x, at.y);
  PatchPixel pixel;
  pixel.intensity = sample.intensity;
  pixel.inside = point.front && at.inside;
  if (!pixel.inside) return pixel;
  RayGradient<double> gradient;
  rayGradient(warp, point, sample.dx, sample.dy, gradient);
  poseJacobian(point, gradient, rho * point.inverse_z, pixel.J_pose.data());
  depthJacobian(warp, point, gradient, pixel.J_inverse_depth);
  return pixel;
}

}  // namespace

PatchResidual evaluatePatch(const HostPatch& patch,
                            const PatchTarget& target,
                            double inverse_depth,
                            PhotometricBrightness brightness) {
  const auto warp = makeWarp<double>(*target.camera, target.T_cam_ref);
  const Eigen::Vector2d centre = target.camera->unproject(patch.pixel.cast<double>()).head<2>();
  PatchResidual out;
  out.inside = true;
  PatchVector grey;
  PatchVector host;
  for (int j = 0; j < kPatternSize; ++j) {
    const auto index = static_cast<std::size_t>(j);
    const Eigen::Vector2d ray =
        centre + Eigen::Vector2d(kPattern[index].x / warp.fx, kPattern[index].y / warp.fy);
    const PatchPixel pixel = samplePixel(*target.image, warp, ray, inverse_depth);
    grey[j] = pixel.intensity;
    host[j] = static_cast<double>(patch.grey[index]);
    out.J_pose.row(j) = pixel.J_pose;
    out.J_inverse_depth[j] = pixel.J_inverse_depth;
    out.inside = out.inside && pixel.inside && std::isfinite(pixel.intensity);
  }
  out.J_affine.setZero();
  if (brightness == PhotometricBrightness::kAffine) {
    out.residual = grey.array() - target.transfer.gain * host.array() - target.transfer.offset;
    out.J_affine.col(0) = -target.transfer.gain * host;
    out.J_affine.col(1).setConstant(-1);
  } else {
    const PatchVector share = host / std::max(host.sum(), double{kMinGreySum});
    out.residual = grey - grey.sum() * share;
  }
  return out;
}

PatchTarget patchTarget(const PhotometricProblem& problem,
                        const PhotometricState& state,
                        std::size_t frame) {
  return {problem.frames[frame].image,
          &problem.camera,
          state.T_cam_ref[frame],
          brightnessTransfer(
              {}, problem.reference_exposure, state.affine[frame], problem.frames[frame].exposure)};
}

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
    const auto root_weight = static_cast<double>(patch_.root_weight[static_cast<std::size_t>(j)]);
    const double threshold = setting_.huber_threshold;
    const bool valid = std::isfinite(r);
    // The root of Huber's loss, which Ceres squares; robust_loss.h has the loss and its weight.
    const double robust = std::abs(r) <= threshold
                              ? std::abs(r)
                              : std::sqrt(2 * threshold * std::abs(r) - threshold * threshold);
    residuals[j] = root_weight * (valid ? std::copysign(robust, r) : threshold);
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
