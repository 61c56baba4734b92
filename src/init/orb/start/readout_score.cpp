// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/start/readout_score.h"

#include "estimate/marginals.h"
#include "init/orb/bundle/frame_motions.h"
#include "init/orb/bundle/geometric_covariance.h"
#include "init/orb/bundle/reprojection_equations.h"

#include <cmath>
#include <vector>

namespace dsorb::init_orb {
namespace {

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
                                       const PoseRows& rows,
                                       const std::vector<Vector6d>& by_readout,
                                       const PinholeCamera& camera,
                                       const GeometricOptions& options) {
  LinearSystem<double> system;
  const Eigen::Index readout = rows.size;
  system.reset(readout + 1, wholeLanes(map.corners.size()));
  for (std::size_t i = 0; i < map.observations.size(); ++i) {
    const CornerObservation& observation = map.observations[i];
    const int row = rows.first[observation.frame];
    if (row < 0) continue;
    const auto projection = projectCorner(map, camera, observation);
    if (!projection) continue;
    const Eigen::Matrix2d whitening = observation.whitening / options.sigma;
    const Eigen::Vector2d error = whitening * (projection->pixel - observation.pixel);
    const double weight = robustWeight(error.norm(), options);
    Eigen::Matrix<double, 2, kPoseSize + 1> J;
    J << whitening * projection->J_pose, whitening * (projection->J_pose * by_readout[i]);
    const Eigen::Vector2d J_depth = whitening * projection->J_inverse_depth;
    const Eigen::Matrix<double, kPoseSize + 1, kPoseSize + 1> H = weight * J.transpose() * J;
    const Eigen::Matrix<double, kPoseSize + 1, 1> b = weight * J.transpose() * error;
    const Eigen::Matrix<double, kPoseSize + 1, 1> c = weight * J.transpose() * J_depth;
    system.H.block<kPoseSize, kPoseSize>(row, row) += H.topLeftCorner<kPoseSize, kPoseSize>();
    system.H.block<kPoseSize, 1>(row, readout) += H.topRightCorner<kPoseSize, 1>();
    system.H.block<1, kPoseSize>(readout, row) += H.bottomLeftCorner<1, kPoseSize>();
    system.H(readout, readout) += H(kPoseSize, kPoseSize);
    system.b.segment<kPoseSize>(row) += b.head<kPoseSize>();
    system.b[readout] += b[kPoseSize];
    double* coupling = system.coupling.data() + observation.corner * system.stride;
    Eigen::Map<Vector6d>(coupling + row) += c.head<kPoseSize>();
    coupling[readout] += c[kPoseSize];
    system.depth_hessian[observation.corner] += weight * J_depth.squaredNorm();
    system.depth_gradient[observation.corner] += weight * J_depth.dot(error);
  }
  return system;
}

}  // namespace

std::optional<Readout> scoreReadout(const InitialMap& map,
                                    const PinholeCamera& camera,
                                    const GeometricOptions& options) {
  const PoseRows rows(map);
  const std::vector<RowMotion> motions = motionsByPoses(map, camera);
  std::vector<Vector6d> by_readout(map.observations.size(), Vector6d::Zero());
  for (std::size_t i = 0; i < by_readout.size(); ++i) {
    const CornerObservation& observation = map.observations[i];
    if (rows.first[observation.frame] < 0) continue;
    by_readout[i] = poseByReadout(map, motions, camera, observation);
  }
  const LinearSystem<double> system = systemWithReadout(map, rows, by_readout, camera, options);
  const ReprojectionState state(map, rows);
  Eigen::VectorXd scale = Eigen::VectorXd::Zero(system.size());
  if (!map.scaleKnown()) scale.head(rows.size) = scaleDirection(state.T_cam_ref, kPoseSize);
  const Marginals marginals(system, scale, state.inverse_depth);
  DampedSolver<double> solver;
  constexpr double kScaleDamping = 1e-6;  // the scale is free
  if (!marginals.usable() || !solver.solve(system, kScaleDamping)) return std::nullopt;
  const Eigen::MatrixXd gradients =
      cellGradients(map, system, camera, options, [&](std::size_t i, const Vector6d& by_pose) {
        Eigen::VectorXd gradient = Eigen::VectorXd::Zero(system.size());
        gradient.segment<kPoseSize>(rows.first[map.observations[i].frame]) = by_pose;
        gradient[rows.size] = by_pose.dot(by_readout[i]);
        return gradient;
      });
  const Eigen::MatrixXd clustered = marginals.clusteredRoots(gradients, rows.size / kPoseSize);
  const double variance = marginals.roots().row(rows.size).squaredNorm() +
                          map.cluster_variance_scale * clustered.row(rows.size).squaredNorm();
  if (!std::isfinite(variance)) return std::nullopt;
  return Readout{solver.step()[rows.size], std::sqrt(variance)};
}

}  // namespace dsorb::init_orb
