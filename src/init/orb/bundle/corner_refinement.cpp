// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/bundle/corner_refinement.h"

#include "base/angles.h"
#include "base/parallel.h"
#include "estimate/pose_from_points.h"
#include "image/photometric.h"
#include "init/orb/bundle/frame_motions.h"
#include "init/orb/bundle/map_assembly.h"
#include "init/orb/bundle/patch_alignment.h"
#include "init/orb/bundle/pose_covariance.h"
#include "init/orb/bundle/robust_adjustment.h"
#include "init/orb/map/frame_brightness.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <utility>

namespace dsorb::init_orb {
namespace {

constexpr int kRounds = 5;      // at most. docs/experiments.md, "Refinement of corners"
constexpr int kIterations = 2;  // of the adjustment in each round; 2 to 6 give the same starts
constexpr double kCauchyThreshold = 2;  // of the whitened error [-]
constexpr double kMaxResidual = 25;  // mean of a patch, above which the corner goes [grey levels]
constexpr double kMinCornerSigma = 0.05;  // of a corner however strong its gradients [px]
constexpr double kMaxTurnDeg = 15;        // of the direction of translation; beyond it, rejected
constexpr double kSettledDeg = .03;       // less in a round: the others change nothing
constexpr double kMinGradient = 1;        // rms in the weakest direction [grey levels / px]
constexpr double kMeasuredSigma = 0.2;  // of a measured corner, for the pose of a single frame [px]
/// Share of the adjustment's variance factor for the own part of a single frame's pose; the rest
/// comes with the inverse depths.
/// @source docs/experiments.md, "Refinement of corners"
constexpr double kOwnFactor = 0.5;
/// Share of the corners that must match the images.
constexpr double kMinFittingShare = 0.5;
constexpr int kBrightnessRounds = 2;  // the pixels hardly move in the others
constexpr double kMinPoseStep =
    1e-5;  // of a single frame's pose, which ends its rounds: below .01 px
constexpr std::size_t kMeasuredAtOnce = 64;  // observations one thread measures at a time

/// One a corner; none where it cannot be cut.
using Patches = std::vector<std::optional<CornerPatch>>;

/// Cuts the corners' patches out of the reference.
Patches cutPatches(const InitialMap& map) {
  Patches patches(map.corners.size());
  forEachRange(patches.size(), kMeasuredAtOnce, [&](std::size_t begin, std::size_t end) {
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

struct Round {
  double rms = 0;
  int dropped = 0;
};

/// Measures every observation in a posed frame again.
std::vector<std::optional<Measurement>> measureAll(const InitialMap& map,
                                                   const PinholeCamera& camera,
                                                   const Patches& patches) {
  std::vector<std::optional<FrameMeasurer>> measurers(map.frames.size());
  for (std::size_t k = 1; k < measurers.size(); ++k) {
    if (map.frames[k].T_cam_ref) measurers[k].emplace(map, camera, k, *map.frames[k].T_cam_ref);
  }
  std::vector<std::optional<Measurement>> measurements(map.observations.size());
  forEachRange(measurements.size(), kMeasuredAtOnce, [&](std::size_t begin, std::size_t end) {
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
Round measureCorners(InitialMap& map, Patches& patches, const PinholeCamera& camera, double sigma) {
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
  Round round;
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
  round.rms = weight > 0 ? std::sqrt(square / weight) : 0;
  round.dropped = removeCorners(map, removed);
  eraseMarked(removed, patches);
  return round;
}

/// A pose with the observations it was fitted to.
struct FittedPose {
  SE3 T_cam_ref;
  std::vector<PointObservation> observations;
  double sigma = kTrackSigma;  ///< of an observation [px]
};

/// Pose of a single frame from its corners, measured again several times.
FittedPose refinePose(const InitialMap& map,
                      const PinholeCamera& camera,
                      const Patches& patches,
                      std::size_t frame) {
  std::vector<std::size_t> seen;
  for (const CornerObservation& observation : map.observations) {
    if (observation.frame == frame) seen.push_back(observation.corner);
  }
  FittedPose fit{*map.frames[frame].T_cam_ref, {}};
  std::vector<PointObservation> observations;
  for (int round = 0; round < kRounds; ++round) {
    const FrameMeasurer measurer(map, camera, frame, fit.T_cam_ref);
    observations.clear();
    for (const std::size_t i : seen) {
      const Corner& corner = map.corners[i];
      const auto measurement = measurer.measure(corner, patches[i]);
      if (!measurement || measurement->mean_residual > kMaxResidual ||
          !strongEnough(measurement->information)) {
        continue;
      }
      observations.push_back(
          {camera.unproject(corner.pixel), corner.inverse_depth, measurement->pixel});
    }
    const auto found = poseFromPoints(observations, camera, fit.T_cam_ref, kMeasuredSigma);
    if (!found) break;
    const double step = (*found * fit.T_cam_ref.inverse()).log().norm();
    fit.T_cam_ref = *found;
    fit.observations.swap(observations);
    fit.sigma = kMeasuredSigma;
    if (step < kMinPoseStep) break;
  }
  if (fit.observations.empty()) fit.observations = observationsByFrame(map, camera)[frame];
  return fit;
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
    const Round measured = measureCorners(refined, patches, camera, geometric.sigma);
    report.dropped += measured.dropped;
    if (round == 0) report.first_rms = measured.rms;
    report.last_rms = measured.rms;
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
                    static_cast<int>(refined.corners.size()) >= kMinAdjusted;
  if (report.accepted) map = std::move(refined);
  return report;
}

void refinePoses(InitialMap& map,
                 const PinholeCamera& camera,
                 const GeometricOptions& geometric,
                 const std::vector<std::size_t>& frames) {
  if (frames.empty()) return;
  estimateBrightness(map, camera, frames);
  const Patches patches = cutPatches(map);
  const InheritedPoseError inherited(map, camera, geometric);
  const double factor = kOwnFactor * map.cluster_variance_scale;
  std::vector<SE3> poses(frames.size());
  std::vector<std::optional<Matrix6d>> covariances(frames.size());
  forEachRange(frames.size(), 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const FittedPose fit = refinePose(map, camera, patches, frames[i]);
      poses[i] = fit.T_cam_ref;
      covariances[i] = poseCovariance(fit.observations, camera, poses[i], {fit.sigma, factor});
      if (covariances[i]) *covariances[i] += inherited.covariance(poses[i]);
    }
  });
  for (std::size_t i = 0; i < frames.size(); ++i) {
    PosedFrame& frame = map.frames[frames[i]];
    frame.T_cam_ref = poses[i];
    frame.covariance = covariances[i] ? *covariances[i] : interpolatedCovariance(map, frames[i]);
  }
}

}  // namespace dsorb::init_orb
