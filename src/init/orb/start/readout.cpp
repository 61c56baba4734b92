// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/start/readout.h"

#include "dsorb/camera/row_times.h"

#include "estimate/marginals.h"
#include "estimate/rolling_shutter.h"
#include "init/orb/bundle/geometric_covariance.h"
#include "init/orb/bundle/map_assembly.h"
#include "init/orb/bundle/reprojection_equations.h"
#include "init/orb/start/essential_start.h"
#include "two_view/essential_motion.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>
#include <vector>

namespace dsorb::init_orb {
namespace {

constexpr std::size_t kParabolaNodes = 3;  // of a parabola

/// A corner where a row saw it.
struct RowObservation {
  std::size_t frame = 0;
  double time = 0;  ///< of the row [s]
  Eigen::Vector2d position{0, 0};
};

/// Position at a time, by the polynomial through some observations [px].
Eigen::Vector2d interpolate(const RowObservation* nodes, std::size_t count, double time) {
  Eigen::Vector2d sum(0, 0);
  for (std::size_t i = 0; i < count; ++i) {
    double weight = 1;
    for (std::size_t j = 0; j < count; ++j) {
      if (j != i) weight *= (time - nodes[j].time) / (nodes[i].time - nodes[j].time);
    }
    sum += weight * nodes[i].position;
  }
  return sum;
}

constexpr std::size_t kNodes = 5;  // the calibrated readout is the middle one
constexpr double kReach = 1.5;  // outermost nodes [standard deviations of the calibrated readout]
/// What an estimate must gain in the logarithm of the posterior, as at two standard deviations:
/// many cameras are just as calibrated, with a global shutter.
constexpr double kMinGain = 2;

/// Negative logarithm of the posterior of a readout, but for a constant. The noise is not known, so
/// that its likelihood is a power of the mean cost; the errors of a cell of the image count as one.
double negativeLogPosterior(const ReferenceView& seen,
                            const Readout& readout,
                            const AttemptContext& context) {
  constexpr double kNever = std::numeric_limits<double>::infinity();
  const ReferenceView view = withGlobalShutter(seen, readout);
  const Matches matches = view.tracks.matchesTo(view.tracks.frames() - 1);
  const auto motion = estimateEssentialMotion(matches, context.camera, context.seed());
  if (!motion) return kNever;
  const auto candidate = makeCandidate(view, *motion, context);
  if (!candidate || !(candidate->cost > 0)) return kNever;
  const Readout calibrated = readoutOf(*seen.frames.front());
  const double deviation = (readout.seconds - calibrated.seconds) / calibrated.sigma;
  return 0.5 * occupiedCells(candidate->map, context.camera) * std::log(candidate->cost) +
         0.5 * deviation * deviation;
}

/// How far into the readout a row comes, from the middle one [-].
double shareOf(double y, const PinholeCamera& camera) {
  return y / (camera.height - 1) - 0.5;
}

/// Change of a frame's pose by the readout, as the rows of an observation and its host see it.
Vector6d poseByReadout(const InitialMap& map,
                       const std::vector<RowMotion>& motions,
                       const PinholeCamera& camera,
                       const CornerObservation& observation) {
  const Corner& corner = map.corners[observation.corner];
  const SE3& T_cam_ref = *map.frames[observation.frame].T_cam_ref;
  return shareOf(observation.pixel.y(), camera) * motions[observation.frame].velocity -
         shareOf(corner.pixel.y(), camera) * (T_cam_ref.adjoint() * motions.front().velocity);
}

/// Equations of poses and inverse depths with one unknown more, the readout.
LinearSystem<double> systemWithReadout(const InitialMap& map,
                                       const UnknownRows& rows,
                                       const std::vector<Vector6d>& by_readout,
                                       const PinholeCamera& camera,
                                       const GeometricOptions& options) {
  LinearSystem<double> system;
  const Eigen::Index readout = rows.poses;
  system.reset(readout + 1, wholeLanes(map.corners.size()));
  for (std::size_t i = 0; i < map.observations.size(); ++i) {
    const CornerObservation& observation = map.observations[i];
    const int row = rows.first[observation.frame];
    if (row < 0) continue;
    const auto error = errorOf(map, camera, observation, options.sigma);
    if (!error) continue;
    const double weight = robustWeight(error->value.norm(), options);
    Eigen::Matrix<double, 2, kPoseSize + 1> J;
    J << error->J_pose, error->J_pose * by_readout[i];
    const Eigen::Matrix<double, kPoseSize + 1, kPoseSize + 1> H = weight * J.transpose() * J;
    const Eigen::Matrix<double, kPoseSize + 1, 1> b = weight * J.transpose() * error->value;
    const Eigen::Matrix<double, kPoseSize + 1, 1> c = weight * J.transpose() * error->J_depth;
    system.H.block<kPoseSize, kPoseSize>(row, row) += H.topLeftCorner<kPoseSize, kPoseSize>();
    system.H.block<kPoseSize, 1>(row, readout) += H.topRightCorner<kPoseSize, 1>();
    system.H.block<1, kPoseSize>(readout, row) += H.bottomLeftCorner<1, kPoseSize>();
    system.H(readout, readout) += H(kPoseSize, kPoseSize);
    system.b.segment<kPoseSize>(row) += b.head<kPoseSize>();
    system.b[readout] += b[kPoseSize];
    double* coupling = system.coupling.data() + observation.corner * system.stride;
    Eigen::Map<Vector6d>(coupling + row) += c.head<kPoseSize>();
    coupling[readout] += c[kPoseSize];
    system.depth_hessian[observation.corner] += weight * error->J_depth.squaredNorm();
    system.depth_gradient[observation.corner] += weight * error->J_depth.dot(error->value);
  }
  return system;
}

}  // namespace

CornerTracks atMiddleRows(CornerTracks tracks,
                          const std::vector<FramePtr>& frames,
                          double readout_change) {
  if (frames.size() < kParabolaNodes) return tracks;
  tracks.seen = tracks.positions.front();
  std::vector<RowTimes> rows;
  rows.reserve(frames.size());
  for (const FramePtr& frame : frames) rows.push_back(rowTimesOf(*frame, readout_change));
  std::vector<RowObservation> observations;
  for (std::size_t i = 0; i < tracks.seen.size(); ++i) {
    observations.clear();
    for (std::size_t k = 0; k < frames.size(); ++k) {
      const Eigen::Vector2d position = tracks.positions[k][i].cast<double>();
      if (!position.allFinite()) continue;
      observations.push_back(
          {k, frames[k]->timestamp() + rows[k].at(position.x(), position.y()), position});
    }
    const std::size_t nodes = std::min(kParabolaNodes, observations.size());
    for (std::size_t s = 0; s < observations.size(); ++s) {
      const std::size_t first = std::clamp<std::size_t>(s, 1, observations.size() + 1 - nodes) - 1;
      const std::size_t frame = observations[s].frame;
      tracks.positions[frame][i] =
          interpolate(&observations[first], nodes, frames[frame]->timestamp()).cast<float>();
    }
  }
  return tracks;
}

ReferenceView withGlobalShutter(ReferenceView seen, const Readout& readout) {
  const Frame& reference = *seen.frames.front();
  if (!isRolling(reference)) return seen;
  seen.readout = readout;
  seen.tracks = atMiddleRows(
      std::move(seen.tracks), seen.frames, readout.seconds - readoutOf(reference).seconds);
  return seen;
}

Readout profileReadout(const ReferenceView& seen, const AttemptContext& context) {
  const Readout calibrated = readoutOf(*seen.frames.front());
  const double step = 2 * kReach * calibrated.sigma / (kNodes - 1);
  const auto node_at = [&](std::size_t i) {
    return Readout{calibrated.seconds - kReach * calibrated.sigma + static_cast<double>(i) * step,
                   calibrated.sigma};
  };
  std::array<double, kNodes> profile{};
  for (std::size_t i = 0; i < kNodes; ++i) {
    profile[i] = negativeLogPosterior(seen, node_at(i), context);
  }
  const auto least =
      static_cast<std::size_t>(std::min_element(profile.begin(), profile.end()) - profile.begin());
  if (!std::isfinite(profile[least])) return calibrated;
  const std::size_t middle = std::clamp<std::size_t>(least, 1, kNodes - 2);
  const double slope = (profile[middle + 1] - profile[middle - 1]) / (2 * step);
  const double curvature =
      (profile[middle + 1] - 2 * profile[middle] + profile[middle - 1]) / (step * step);
  if (!(curvature > 0) || !std::isfinite(curvature)) {
    return profile[kNodes / 2] - profile[least] < kMinGain ? calibrated : node_at(least);
  }
  const double move = std::clamp(-slope / curvature, -step, step);
  const double lowest = profile[middle] + move * (slope + 0.5 * move * curvature);
  if (profile[kNodes / 2] - lowest < kMinGain) return calibrated;
  return {node_at(middle).seconds + move, 1 / std::sqrt(curvature)};
}

std::optional<Readout> scoreReadout(const InitialMap& map,
                                    const PinholeCamera& camera,
                                    const GeometricOptions& options) {
  const UnknownRows rows(map);
  const std::vector<RowMotion> motions = motionsByPoses(map, camera);
  std::vector<Vector6d> by_readout(map.observations.size(), Vector6d::Zero());
  for (std::size_t i = 0; i < by_readout.size(); ++i) {
    const CornerObservation& observation = map.observations[i];
    if (rows.first[observation.frame] < 0) continue;
    by_readout[i] = poseByReadout(map, motions, camera, observation);
  }
  const LinearSystem<double> system = systemWithReadout(map, rows, by_readout, camera, options);
  Eigen::VectorXd scale = Eigen::VectorXd::Zero(system.size());
  if (!map.scaleKnown()) scale.head(rows.poses) = rows.scaleDirection(map).head(rows.poses);
  const Marginals marginals(system, scale, ReprojectionState(map, rows).inverse_depth);
  DampedSolver solver;
  constexpr double kScaleDamping = 1e-6;  // the scale is free
  if (!marginals.usable() || !solver.solve(system, kScaleDamping)) return std::nullopt;
  const Eigen::MatrixXd gradients =
      cellGradients(map,
                    system,
                    camera,
                    options,
                    [&](std::size_t i, const Vector6d& by_pose, Eigen::Ref<Eigen::VectorXd> all) {
                      all.segment<kPoseSize>(rows.first[map.observations[i].frame]) += by_pose;
                      all[rows.poses] += by_pose.dot(by_readout[i]);
                    });
  const Eigen::MatrixXd clustered = marginals.clusteredRoots(gradients, rows.poses / kPoseSize);
  const double variance = marginals.roots().row(rows.poses).squaredNorm() +
                          map.cluster_variance_scale * clustered.row(rows.poses).squaredNorm();
  if (!std::isfinite(variance)) return std::nullopt;
  return Readout{solver.step()[rows.poses], std::sqrt(variance)};
}

}  // namespace dsorb::init_orb
