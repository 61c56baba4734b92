// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/corner_polish.h"

#include "base/parallel.h"
#include "camera/reprojection.h"
#include "image/interpolate.h"
#include "init/orb/frame_brightness.h"
#include "init/orb/pose_from_points.h"
#include "init/orb/robust_adjustment.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

namespace dsorb::init_orb {
namespace {

constexpr double kDegPerRad = 180.0 / M_PI;
constexpr int kPatchSide = 5;
constexpr int kPatchStep = 2;           // [px] between two samples
constexpr double kDamping = 1e-3;       // of the mean curvature
constexpr double kMinGradient = 1;      // rms in the weakest direction [grey levels / px]
constexpr double kMeasuredSigma = 0.2;  // of a measured corner, for the pose of a single frame [px]
constexpr std::size_t kGrain = 64;      // observations one thread measures at a time
constexpr std::size_t kPatchSize = std::size_t{kPatchSide} * kPatchSide;

/// What a patch in one frame says about its corner.
struct Measurement {
  bool valid = false;
  Eigen::Vector2d pixel{0, 0};
  Eigen::Matrix2d information = Eigen::Matrix2d::Zero();  // H over the squared noise of a pixel = 1
  double weighted_square = 0;                             // sum of w r^2
  double weight = 0;                                      // sum of w
  double mean_residual = 0;                               // of |r| [grey levels]
};

/// Offset of a sample from the patch's centre [px].
Eigen::Vector2d sampleOffset(std::size_t index) {
  constexpr int kRadius = kPatchSide / 2;
  const auto i = static_cast<int>(index);
  return {kPatchStep * (i % kPatchSide - kRadius), kPatchStep * (i / kPatchSide - kRadius)};
}

class PatchMeasurer {
 public:
  PatchMeasurer(const InitialMap& map, const PinholeCamera& camera, const PolishOptions& options)
      : map_(map), camera_(camera), options_(options) {}

  /// One damped Gauss-Newton step from the corner's projection.
  [[nodiscard]] Measurement measure(const Observation& observation) const {
    Measurement measurement;
    const Corner& corner = map_.corners[static_cast<std::size_t>(observation.corner)];
    const auto frame = static_cast<std::size_t>(observation.frame);
    const SE3& pose = *map_.T_cam_ref[frame];
    const auto centre =
        projectHosted(camera_, pose, camera_.unproject(corner.pixel), corner.inverse_depth);
    if (!centre) return measurement;
    const BrightnessTransfer transfer = brightnessTransfer(map_.affine.front(),
                                                           map_.frames.front()->exposure(),
                                                           map_.affine[frame],
                                                           map_.frames[frame]->exposure());
    const Eigen::Matrix3d R = pose.rotationMatrix();
    const Patch patch{
        corner.pixel,
        R * camera_.unproject(corner.pixel) + corner.inverse_depth * pose.translation(),
        R.col(0) / camera_.fx,
        R.col(1) / camera_.fy};
    Eigen::Vector2d b(0, 0);
    for (std::size_t i = 0; i < kPatchSize; ++i) {
      const auto sample = sampleBoth(patch, frame, sampleOffset(i));
      if (!sample) return Measurement();
      const double residual =
          sample->target.intensity - transfer.gain * sample->reference - transfer.offset;
      const double magnitude = std::abs(residual);
      const double weight =
          magnitude > options_.huber_threshold ? options_.huber_threshold / magnitude : 1.0;
      const Eigen::Vector2d gradient(sample->target.dx, sample->target.dy);
      measurement.information += weight * gradient * gradient.transpose();
      b += weight * residual * gradient;
      measurement.weighted_square += weight * residual * residual;
      measurement.weight += weight;
      measurement.mean_residual += magnitude / kPatchSize;
    }
    Eigen::Matrix2d damped = measurement.information;
    damped.diagonal().array() += kDamping * 0.5 * damped.trace();
    Eigen::Vector2d step = -damped.ldlt().solve(b);
    if (!step.allFinite()) return Measurement();
    if (step.norm() > options_.max_step) step *= options_.max_step / step.norm();
    measurement.pixel = centre->pixel + step;
    measurement.valid = true;
    return measurement;
  }

 private:
  struct Sample {
    double reference;
    ImageSample target;
  };

  /// A corner's patch seen from another frame: all at the corner's inverse depth.
  struct Patch {
    Eigen::Vector2d pixel;   // in the reference
    Eigen::Vector3d centre;  // direction in the frame
    Eigen::Vector3d by_x;    // and its change by the pixel's coordinates [1/px]
    Eigen::Vector3d by_y;
  };

  [[nodiscard]] std::optional<Sample> sampleBoth(const Patch& patch,
                                                 std::size_t frame,
                                                 const Eigen::Vector2d& offset) const {
    const PyramidLevel& reference = map_.frames.front()->level(0);
    const PyramidLevel& target = map_.frames[frame]->level(0);
    const Eigen::Vector2d host = patch.pixel + offset;
    const Eigen::Vector3d p = patch.centre + offset.x() * patch.by_x + offset.y() * patch.by_y;
    if (!(p.z() > 0)) return std::nullopt;
    const Eigen::Vector2f from = host.cast<float>();
    const Eigen::Vector2f to = camera_.project(p).cast<float>();
    if (!insideForInterpolation(reference, from.x(), from.y()) ||
        !insideForInterpolation(target, to.x(), to.y(), 1)) {
      return std::nullopt;
    }
    const Sample sample{interpolateIntensity(reference, from.x(), from.y()),
                        interpolate(target, to.x(), to.y())};
    if (!std::isfinite(sample.reference) || !std::isfinite(sample.target.intensity)) {
      return std::nullopt;
    }
    return sample;
  }

  const InitialMap& map_;
  const PinholeCamera& camera_;
  const PolishOptions& options_;
};

/// Inverse square root of a corner's covariance, from the mean information of its patches.
Eigen::Matrix2d whiteningOf(const Eigen::Matrix2d& information, const PolishOptions& options) {
  const Eigen::Matrix2d covariance =
      options.image_noise * options.image_noise * information.inverse() +
      options.min_sigma * options.min_sigma * Eigen::Matrix2d::Identity();
  return covariance.llt().matrixL().solve(Eigen::Matrix2d::Identity());
}

bool strongEnough(const Eigen::Matrix2d& information) {
  // The smaller eigenvalue is at least determinant over trace.
  return information.determinant() > kPatchSize * kMinGradient * kMinGradient * information.trace();
}

struct Round {
  double rms = 0;
  int dropped = 0;
};

/// Replaces observations in posed frames by new measurements; those without keep the old pixel.
/// @param sigma of old pixels
Round measureAll(InitialMap& map,
                 const PinholeCamera& camera,
                 double sigma,
                 const PolishOptions& options) {
  const PatchMeasurer measurer(map, camera, options);
  std::vector<Measurement> measurements(map.observations.size());
  forEachRange(measurements.size(), kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const Observation& observation = map.observations[i];
      if (map.T_cam_ref[static_cast<std::size_t>(observation.frame)]) {
        measurements[i] = measurer.measure(observation);
      }
    }
  });
  std::vector<char> removed(map.corners.size(), 0);
  std::vector<Eigen::Matrix2d> information(map.corners.size(), Eigen::Matrix2d::Zero());
  std::vector<int> patches(map.corners.size(), 0);
  for (std::size_t i = 0; i < measurements.size(); ++i) {
    if (!measurements[i].valid) continue;
    const auto corner = static_cast<std::size_t>(map.observations[i].corner);
    information[corner] += measurements[i].information;
    ++patches[corner];
    if (measurements[i].mean_residual > options.max_residual) removed[corner] = 1;
  }
  Round round;
  double square = 0;
  double weight = 0;
  for (std::size_t i = 0; i < measurements.size(); ++i) {
    Observation& observation = map.observations[i];
    const auto corner = static_cast<std::size_t>(observation.corner);
    const Eigen::Matrix2d mean = information[corner] / std::max(1, patches[corner]);
    if (!measurements[i].valid || !strongEnough(mean)) {
      if (observation.whitening.isIdentity(0)) observation.whitening /= sigma;
      continue;
    }
    observation.pixel = measurements[i].pixel;
    observation.whitening = whiteningOf(mean, options);
    if (removed[corner] != 0) continue;
    square += measurements[i].weighted_square;
    weight += measurements[i].weight;
  }
  round.rms = weight > 0 ? std::sqrt(square / weight) : 0;
  round.dropped = static_cast<int>(std::count(removed.begin(), removed.end(), char{1}));
  removeCorners(map, removed);
  return round;
}

/// A corner's measurements in one frame, those that can be believed.
std::vector<PointSighting> measureFrame(const InitialMap& map,
                                        const PinholeCamera& camera,
                                        const PolishOptions& options,
                                        int frame) {
  const PatchMeasurer measurer(map, camera, options);
  std::vector<PointSighting> sightings;
  for (const Observation& observation : map.observations) {
    if (observation.frame != frame) continue;
    const Measurement measurement = measurer.measure(observation);
    if (!measurement.valid || measurement.mean_residual > options.max_residual ||
        !strongEnough(measurement.information)) {
      continue;
    }
    const Corner& corner = map.corners[static_cast<std::size_t>(observation.corner)];
    sightings.push_back({camera.unproject(corner.pixel), corner.inverse_depth, measurement.pixel});
  }
  return sightings;
}

double turnDeg(const InitialMap& before, const InitialMap& after) {
  const Eigen::Vector3d& from = before.T_cam_ref.back()->translation();
  const Eigen::Vector3d& to = after.T_cam_ref.back()->translation();
  return std::atan2(from.cross(to).norm(), from.dot(to)) * kDegPerRad;
}

}  // namespace

PolishReport polishCorners(InitialMap& map,
                           const PinholeCamera& camera,
                           const GeometricOptions& geometric,
                           const PolishOptions& options) {
  PolishReport report;
  report.adjusted = geometric;
  report.adjusted.sigma = 1;  // the whitening has each corner's own
  report.adjusted.loss = RobustLoss::kCauchy;
  report.adjusted.loss_threshold = options.cauchy_threshold;
  report.adjusted.max_iterations = options.iterations;
  InitialMap polished = map;
  for (int round = 0; round < options.rounds; ++round) {
    estimateBrightness(polished);
    const Round measured = measureAll(polished, camera, geometric.sigma, options);
    report.dropped += measured.dropped;
    if (round == 0) report.first_rms = measured.rms;
    report.last_rms = measured.rms;
    if (!adjustOnce(polished, camera, report.adjusted)) return report;
  }
  report.turn_deg = turnDeg(map, polished);
  report.accepted = options.rounds > 0 && report.last_rms <= report.first_rms &&
                    report.turn_deg < options.max_turn_deg &&
                    static_cast<int>(polished.corners.size()) >= geometric.min_points;
  if (report.accepted) map = std::move(polished);
  return report;
}

void polishPoses(InitialMap& map,
                 const PinholeCamera& camera,
                 const PolishOptions& options,
                 const std::vector<int>& frames) {
  estimateBrightness(map, frames);
  std::vector<std::optional<SE3>> poses(frames.size());
  for (int round = 0; round < options.rounds; ++round) {
    forEachRange(frames.size(), 1, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) {
        const SE3& guess = *map.T_cam_ref[static_cast<std::size_t>(frames[i])];
        poses[i] = poseFromPoints(
            measureFrame(map, camera, options, frames[i]), camera, guess, kMeasuredSigma);
      }
    });
    for (std::size_t i = 0; i < frames.size(); ++i) {
      if (poses[i]) map.T_cam_ref[static_cast<std::size_t>(frames[i])] = poses[i];
    }
  }
}

}  // namespace dsorb::init_orb
