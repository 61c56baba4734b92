// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/photometric/photometric_patch.h"

#include "estimate/sampling.h"
#include "estimate/warp.h"

#include <algorithm>
#include <cmath>

namespace dsorb::init_orb {
namespace {

constexpr double kMinGreySum = 8;  // of a patch; psi of a darker one means nothing [grey levels]

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
  PatchResidual out;
  out.inside = true;
  PatchVector grey;
  PatchVector host;
  for (int j = 0; j < kPatternSize; ++j) {
    const auto index = static_cast<std::size_t>(j);
    const Eigen::Vector2d ray =
        patch.ray.cast<double>() +
        Eigen::Vector2d(kPattern[index].x / warp.fx, kPattern[index].y / warp.fy);
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
    const PatchVector share = host / std::max(host.sum(), kMinGreySum);
    out.residual = grey - grey.sum() * share;
  }
  return out;
}

}  // namespace dsorb::init_orb
