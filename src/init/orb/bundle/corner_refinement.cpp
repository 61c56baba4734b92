// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/bundle/corner_refinement.h"

#include "dsorb/camera/pinhole_camera.h"

#include "base/angles.h"
#include "base/erase_marked.h"
#include "base/lanes.h"
#include "base/parallel.h"
#include "base/target_clones.h"
#include "estimate/robust_loss.h"
#include "estimate/sampling.h"
#include "estimate/target_image.h"
#include "estimate/warp.h"
#include "image/photometric.h"
#include "init/orb/bundle/map_assembly.h"
#include "init/orb/bundle/robust_adjustment.h"
#include "init/orb/map/initial_map.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <optional>
#include <utility>

namespace dsorb::init_orb {
namespace {

constexpr int kPatchSide = 5;
constexpr int kPatchStep = 2;  ///< [px] between two samples
constexpr std::size_t kPatchPixels = std::size_t{kPatchSide} * kPatchSide;
constexpr std::size_t kPatchLanes = 32;  ///< pixels filled up to whole lanes

/// Grey values of the reference around a corner.
using CornerPatch = std::array<float, kPatchLanes>;

/// Measurement of a corner by its patch in one frame.
struct Measurement {
  Eigen::Vector2d pixel{0, 0};
  Eigen::Matrix2d information = Eigen::Matrix2d::Zero();  ///< for a squared noise of a pixel of 1
  double weighted_square = 0;                             ///< sum of w r^2, w Huber's weight
  double weight = 0;                                      ///< sum of w
  double mean_residual = 0;                               ///< of |r| [grey levels]
};

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
  for (std::size_t i = 0; i < kPatchLanes; i += kLanes) {
    const Lanes used = load(&kOffsets.used[i]);
    const Lanes ray_x = ray.x() + step_x * load(&kOffsets.x[i]);
    const Lanes ray_y = ray.y() + step_y * load(&kOffsets.y[i]);
    const WarpedPoint<Lanes> point = projectInto<kRolling>(target, ray_x, ray_y, inverse_depth);
    MaskOf<Lanes> inside;
    const LaneSamples samples = sampleTarget(target, point, inside);
    if (!inAllLanes(inside)) return false;
    const Lanes residual =
        (samples.intensity - target.gain * load(&patch[i]) - target.offset) * used;
    const Lanes weight = huberWeights(residual) * used;
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
  totals = sumLanes(terms);
  return true;
}

DSORB_TARGET_CLONES bool linearizePatch(const TargetImage& target,
                                        const CornerPatch& patch,
                                        const Eigen::Vector2f& ray,
                                        float inverse_depth,
                                        Lanes& totals) {
  return target.corrected ? linearizeAs<true>(target, patch, ray, inverse_depth, totals)
                          : linearizeAs<false>(target, patch, ray, inverse_depth, totals);
}

/// @return nullopt where the patch leaves the image or touches an invalid pixel
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

/// Measures corners in one frame: aligns their patches, warped by pose and inverse depth.
class FrameMeasurer {
 public:
  /// @param frame that has a pose
  FrameMeasurer(const InitialMap& map, const PinholeCamera& camera, std::size_t frame)
      : camera_(camera),
        T_cam_ref_(*map.frames[frame].T_cam_ref),
        target_(makeTargetImage(
            camera, T_cam_ref_, brightnessTo(map, frame), map.frames[frame].frame->level(0))) {
    if (const auto shutter = shutterOf(map, frame)) target_.setShutter(*shutter);
  }

  /// One damped Gauss-Newton step from the corner's projection.
  /// @return nullopt where the patch leaves the image or is invalid
  [[nodiscard]] std::optional<Measurement> measure(const Corner& corner,
                                                   const std::optional<CornerPatch>& patch) const {
    const Eigen::Vector3d ray = camera_.unproject(corner.pixel);
    Lanes sums;
    if (!patch || !linearizePatch(target_,
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

 private:
  const PinholeCamera& camera_;
  SE3 T_cam_ref_;
  TargetImage target_;
};

constexpr int kRounds = 5;      // at most
constexpr int kIterations = 2;  // of the adjustment in each round; 2 to 6 give the same starts
constexpr double kCauchyThreshold = 2;  // of the whitened error [-]
constexpr double kMaxResidual = 25;  // mean of a patch, above which the corner goes [grey levels]
constexpr double kMinCornerSigma = 0.05;  // of a corner however strong its gradients [px]
constexpr double kMaxTurnDeg = 15;        // of the direction of translation; beyond it, rejected
constexpr double kSettledDeg = .03;       // less in a round: the others change nothing
constexpr double kMinGradient = 1;        // rms in the weakest direction [grey levels / px]
/// Share of the corners that must match the images.
constexpr double kMinFittingShare = 0.5;
constexpr int kBrightnessRounds = 2;  // the pixels hardly move in the others

/// One a corner; none where it cannot be cut.
using Patches = std::vector<std::optional<CornerPatch>>;

/// Cuts the corners' patches out of the reference.
Patches cutPatches(const InitialMap& map) {
  Patches patches(map.corners.size());
  forEachRange(patches.size(), kTaskGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      patches[i] = cutCornerPatch(map.frames.front().frame->level(0), map.corners[i].seen());
    }
  });
  return patches;
}

/// Inverse square root of a corner's covariance, from the mean information of its patches.
Eigen::Matrix2d whiteningOf(const Eigen::Matrix2d& information) {
  const Eigen::Matrix2d covariance =
      kImageNoise * kImageNoise * information.inverse() +
      kMinCornerSigma * kMinCornerSigma * Eigen::Matrix2d::Identity();
  return covariance.llt().matrixL().solve(Eigen::Matrix2d::Identity());
}

bool strongEnough(const Eigen::Matrix2d& information) {
  // The smaller eigenvalue is at least determinant over trace.
  return information.determinant() >
         kPatchPixels * kMinGradient * kMinGradient * information.trace();
}

/// Measures every observation in a posed frame again.
std::vector<std::optional<Measurement>> measureAll(const InitialMap& map,
                                                   const PinholeCamera& camera,
                                                   const Patches& patches) {
  std::vector<std::optional<FrameMeasurer>> measurers(map.frames.size());
  for (std::size_t k = 1; k < measurers.size(); ++k) {
    if (map.frames[k].T_cam_ref) measurers[k].emplace(map, camera, k);
  }
  std::vector<std::optional<Measurement>> measurements(map.observations.size());
  forEachRange(measurements.size(), kTaskGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const auto& measurer = measurers[map.observations[i].frame];
      const auto corner = map.observations[i].corner;
      if (measurer) measurements[i] = measurer->measure(map.corners[corner], patches[corner]);
    }
  });
  return measurements;
}

/// Summary of all measurements of a corner.
struct CornerSummary {
  Eigen::Matrix2d information = Eigen::Matrix2d::Zero();  // sum
  int patches = 0;
  bool fits = true;
  std::optional<Eigen::Matrix2d> whitening;  // none: too weak

  void finish() {
    const Eigen::Matrix2d mean = information / std::max(1, patches);
    if (strongEnough(mean)) whitening = whiteningOf(mean);
  }
};

/// Replaces observations in posed frames by new measurements; those without keep the old pixel.
/// @param patches of the corners; those of dropped corners go with them
/// @param sigma   of old pixels
/// @return        error of the patches' pixels [grey levels]
double measureCorners(InitialMap& map,
                      Patches& patches,
                      const PinholeCamera& camera,
                      double sigma) {
  const std::vector<std::optional<Measurement>> measurements = measureAll(map, camera, patches);
  std::vector<CornerSummary> summaries(map.corners.size());
  for (std::size_t i = 0; i < measurements.size(); ++i) {
    if (!measurements[i]) continue;
    CornerSummary& summary = summaries[map.observations[i].corner];
    summary.information += measurements[i]->information;
    ++summary.patches;
    if (measurements[i]->mean_residual > kMaxResidual) summary.fits = false;
  }
  for (CornerSummary& summary : summaries) summary.finish();
  double square = 0;
  double weight = 0;
  for (std::size_t i = 0; i < measurements.size(); ++i) {
    CornerObservation& observation = map.observations[i];
    const CornerSummary& summary = summaries[observation.corner];
    if (!measurements[i] || !summary.whitening) {
      if (observation.whitening.isIdentity(0)) observation.whitening /= sigma;
      continue;
    }
    observation.pixel = measurements[i]->pixel;
    observation.whitening = *summary.whitening;
    if (!summary.fits) continue;
    square += measurements[i]->weighted_square;
    weight += measurements[i]->weight;
  }
  std::vector<char> removed(summaries.size());
  std::transform(summaries.begin(), summaries.end(), removed.begin(), [](const auto& summary) {
    return static_cast<char>(summary.fits ? 0 : 1);
  });
  removeCorners(map, removed);
  eraseMarked(removed, patches);
  return weight > 0 ? std::sqrt(square / weight) : 0;
}

const SE3& newestPose(const InitialMap& map) {
  return *map.frames.back().T_cam_ref;
}

double directionChangeDeg(const SE3& before, const SE3& after) {
  return angleDeg(before.translation(), after.translation());
}

}  // namespace

GeometricOptions refinedAdjustment(const GeometricOptions& geometric) {
  GeometricOptions adjusted = geometric;
  adjusted.sigma = 1;
  adjusted.loss = RobustLoss::kCauchy;
  adjusted.loss_threshold = kCauchyThreshold;
  return adjusted;
}

RefinementReport refineCorners(InitialMap& map,
                               const PinholeCamera& camera,
                               const GeometricOptions& geometric,
                               const std::function<bool(const InitialMap&)>& hopeless) {
  RefinementReport report;
  const GeometricOptions adjusted = refinedAdjustment(geometric);
  InitialMap refined = map;
  Patches patches = cutPatches(refined);
  for (int round = 0; round < kRounds; ++round) {
    if (round < kBrightnessRounds) estimateBrightness(refined, camera);
    report.last_rms = measureCorners(refined, patches, camera, geometric.sigma);
    if (round == 0) report.first_rms = report.last_rms;
    const SE3 before = newestPose(refined);
    auto solved = adjustOnce(std::move(refined), camera, adjusted, {kIterations});
    if (!solved) return report;
    refined = std::move(*solved);
    estimateMotions(refined, camera);
    if (round == 0 && hopeless && hopeless(refined)) break;
    if (directionChangeDeg(before, newestPose(refined)) < kSettledDeg) break;
  }
  report.direction_change_deg = directionChangeDeg(newestPose(map), newestPose(refined));
  report.fits = static_cast<double>(refined.corners.size()) >=
                kMinFittingShare * static_cast<double>(map.corners.size());
  report.accepted = report.fits && report.last_rms <= report.first_rms &&
                    report.direction_change_deg < kMaxTurnDeg &&
                    static_cast<int>(refined.corners.size()) >= kMinCornersOfMotion;
  if (report.accepted) map = std::move(refined);
  return report;
}

}  // namespace dsorb::init_orb
