// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/bundle/patch_alignment.h"

#include "base/lanes.h"
#include "base/target_clones.h"
#include "estimate/robust_loss.h"
#include "estimate/sampling.h"

#include <Eigen/LU>

#include <cmath>

namespace dsorb::init_orb {
namespace {

constexpr int kRadius = kPatchSide / 2;
constexpr double kMaxStep = 1;     // of one corner [px]
constexpr double kDamping = 1e-3;  // of the mean curvature

/// Offsets of the samples from the centre [px], and 1 for each; zeros fill up.
struct Offsets {
  std::array<float, kPatchLanes> x{};
  std::array<float, kPatchLanes> y{};
  std::array<float, kPatchLanes> used{};
};

constexpr Offsets makeOffsets() {
  Offsets offsets;
  for (std::size_t i = 0; i < kPatchPixels; ++i) {
    const int index = static_cast<int>(i);
    const int row = index / kPatchSide;
    offsets.x[i] = static_cast<float>(kPatchStep * (index - row * kPatchSide - kRadius));
    offsets.y[i] = static_cast<float>(kPatchStep * (row - kRadius));
    offsets.used[i] = 1;
  }
  return offsets;
}

constexpr Offsets kOffsets = makeOffsets();

/// Residuals of a corner's patch, warped into a frame, over a shift of the patch there.
/// @param ray    of the corner in the reference, z = 1
/// @param totals sums over the pixels: w times the gradient's squares xx, xy, yy and its products
///               with the residual x, y; w r^2, w, |r|
/// @return       false where the patch leaves the image
template <bool kRolling>
DSORB_ALWAYS_INLINE bool linearizeAs(const TargetImage& target,
                                     const CornerPatch& patch,
                                     const Eigen::Vector2f& ray,
                                     float inverse_depth,
                                     Lanes& totals) {
  Lanes terms[8] = {};
  const float step_x = 1.0F / target.warp.fx;
  const float step_y = 1.0F / target.warp.fy;
  SampleArea<Lanes> area;
  sampleArea(target.width, target.height, area);
  for (std::size_t i = 0; i < kPatchLanes; i += kLanes) {
    Lanes offset_x;
    Lanes offset_y;
    Lanes used;
    Lanes grey;
    load(&kOffsets.x[i], offset_x);
    load(&kOffsets.y[i], offset_y);
    load(&kOffsets.used[i], used);
    load(&patch[i], grey);
    const Lanes ray_x = ray.x() + step_x * offset_x;
    const Lanes ray_y = ray.y() + step_y * offset_y;
    WarpedPoint<Lanes> point;
    projectInto<kRolling>(target, ray_x, ray_y, inverse_depth, point);
    LaneSamples samples;
    MaskOf<Lanes> inside;
    sampleTarget(target, area, point, samples, inside);
    if (!inAllLanes(inside)) return false;
    const Lanes residual = (samples.intensity - target.gain * grey - target.offset) * used;
    Lanes weight;
    huberWeights(residual, weight);
    weight *= used;
    const Lanes wx = weight * samples.dx;
    const Lanes wy = weight * samples.dy;
    terms[0] += wx * samples.dx;
    terms[1] += wx * samples.dy;
    terms[2] += wy * samples.dy;
    terms[3] += wx * residual;
    terms[4] += wy * residual;
    terms[5] += weight * residual * residual;
    terms[6] += weight;
    terms[7] += residual < 0.0F ? -residual : residual;
  }
  sumLanes(terms, totals);
  return true;
}

DSORB_TARGET_CLONES bool linearizePatch(const TargetImage& target,
                                        const CornerPatch& patch,
                                        const Eigen::Vector2f& ray,
                                        float inverse_depth,
                                        Lanes& totals) {
  return linearizeAs<false>(target, patch, ray, inverse_depth, totals);
}

DSORB_TARGET_CLONES bool linearizePatchRolling(const TargetImage& target,
                                               const CornerPatch& patch,
                                               const Eigen::Vector2f& ray,
                                               float inverse_depth,
                                               Lanes& totals) {
  return linearizeAs<true>(target, patch, ray, inverse_depth, totals);
}

}  // namespace

std::optional<CornerPatch> cutCornerPatch(const PyramidLevel& reference,
                                          const Eigen::Vector2f& pixel) {
  if (!canSample(reference, pixel.x(), pixel.y(), static_cast<float>(kPatchStep * kRadius))) {
    return std::nullopt;
  }
  CornerPatch patch{};
  float sum = 0;
  for (std::size_t i = 0; i < kPatchPixels; ++i) {
    patch[i] =
        interpolateIntensity(reference, pixel.x() + kOffsets.x[i], pixel.y() + kOffsets.y[i]);
    sum += patch[i];
  }
  return std::isfinite(sum) ? std::optional(patch) : std::nullopt;
}

FrameMeasurer::FrameMeasurer(const InitialMap& map,
                             const PinholeCamera& camera,
                             std::size_t frame,
                             const SE3& T_cam_ref)
    : camera_(camera),
      T_cam_ref_(T_cam_ref),
      target_(makeTargetImage(
          camera, T_cam_ref, brightnessTo(map, frame), map.frames[frame].frame->level(0))) {
  if (const auto shutter = shutterOf(map, frame)) target_.setShutter(*shutter);
}

std::optional<Measurement> FrameMeasurer::measure(const Corner& corner,
                                                  const std::optional<CornerPatch>& patch) const {
  const Eigen::Vector3d ray = camera_.unproject(corner.pixel);
  Lanes sums;
  const auto sum_up = target_.corrected ? linearizePatchRolling : linearizePatch;
  if (!patch || !sum_up(target_,
                        *patch,
                        ray.head<2>().cast<float>(),
                        static_cast<float>(corner.inverse_depth),
                        sums)) {
    return std::nullopt;
  }
  const auto sum = [&sums](int k) { return static_cast<double>(sums[k]); };
  if (!std::isfinite(sum(7))) return std::nullopt;
  Measurement measurement;
  measurement.information << sum(0), sum(1), sum(1), sum(2);
  measurement.weighted_square = sum(5);
  measurement.weight = sum(6);
  measurement.mean_residual = sum(7) / kPatchPixels;
  Eigen::Matrix2d damped = measurement.information;
  damped.diagonal().array() += kDamping * 0.5 * damped.trace();
  Eigen::Vector2d step = -damped.inverse() * Eigen::Vector2d(sum(3), sum(4));
  if (!step.allFinite()) return std::nullopt;
  if (step.norm() > kMaxStep) step *= kMaxStep / step.norm();
  const Eigen::Vector3d direction =
      T_cam_ref_.unitQuaternion() * ray + corner.inverse_depth * T_cam_ref_.translation();
  measurement.pixel = camera_.project(direction) + step;
  return measurement;
}

}  // namespace dsorb::init_orb
