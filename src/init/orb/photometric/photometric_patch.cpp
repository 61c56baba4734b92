// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/photometric/photometric_patch.h"

#include <algorithm>
#include <cmath>

namespace dsorb::init_orb {
namespace {

constexpr double kMinGreySum = 8;  // of a patch; psi of a darker one means nothing [grey levels]

struct Sample {
  double intensity;
  Eigen::RowVector2d gradient;
};

/// Bilinear in double precision.
Sample sampleAt(const PyramidLevel& image, double x, double y) {
  const int ix = static_cast<int>(x);
  const int iy = static_cast<int>(y);
  const double fx = x - ix;
  const double fy = y - iy;
  const auto mix = [&](auto member) {
    const auto at = [&](int dx, int dy) {
      return static_cast<double>(image.at(ix + dx, iy + dy).*member);
    };
    return (1 - fy) * ((1 - fx) * at(0, 0) + fx * at(1, 0)) +
           fy * ((1 - fx) * at(0, 1) + fx * at(1, 1));
  };
  return {mix(&ImageSample::intensity), {mix(&ImageSample::dx), mix(&ImageSample::dy)}};
}

/// Value at one pixel of the pattern and its derivatives, before brightness.
struct PatchPixel {
  double intensity = 0;
  Eigen::Matrix<double, 1, 6> J_pose = Eigen::Matrix<double, 1, 6>::Zero();
  double J_inverse_depth = 0;
  bool inside = false;
};

PatchPixel samplePixel(const PatchTarget& target, const Eigen::Vector3d& ray, double rho) {
  const PinholeCamera& camera = *target.camera;
  const Eigen::Vector3d& t = target.T_cam_ref.translation();
  const Eigen::Vector3d p = target.T_cam_ref.unitQuaternion() * ray + rho * t;
  const double inverse_z = 1 / std::max(p.z(), kMinPatchZ);
  const double u = p.x() * inverse_z;
  const double v = p.y() * inverse_z;
  const double x = camera.fx * u + camera.cx;
  const double y = camera.fy * v + camera.cy;
  const double clamped_x = std::clamp(x, kNearBorder, camera.width - kFarBorder);
  const double clamped_y = std::clamp(y, kNearBorder, camera.height - kFarBorder);
  const Sample sample = sampleAt(*target.image, clamped_x, clamped_y);
  PatchPixel pixel;
  pixel.intensity = sample.intensity;
  pixel.inside = p.z() > kMinPatchZ && x == clamped_x && y == clamped_y;
  if (!pixel.inside) {
    return pixel;
  }
  const double gx = sample.gradient.x() * camera.fx;
  const double gy = sample.gradient.y() * camera.fy;
  const double scaled_rho = rho * inverse_z;
  const double radial = u * gx + v * gy;
  pixel.J_pose << scaled_rho * gx, scaled_rho * gy, -scaled_rho * radial, -gy - v * radial,
      gx + u * radial, u * gy - v * gx;
  pixel.J_inverse_depth = inverse_z * (gx * t.x() + gy * t.y() - radial * t.z());
  return pixel;
}

}  // namespace

PatchResidual evaluatePatch(const HostPatch& patch,
                            const PatchTarget& target,
                            double inverse_depth,
                            PhotometricBrightness brightness) {
  PatchResidual out;
  out.inside = true;
  PatchVector grey;
  PatchVector host;
  for (int j = 0; j < kPatternSize; ++j) {
    const auto index = static_cast<std::size_t>(j);
    const Eigen::Vector3d ray(
        static_cast<double>(patch.ray.x()) + kPattern[index].x / target.camera->fx,
        static_cast<double>(patch.ray.y()) + kPattern[index].y / target.camera->fy,
        1);
    const PatchPixel pixel = samplePixel(target, ray, inverse_depth);
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
