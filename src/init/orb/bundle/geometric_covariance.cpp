// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/bundle/geometric_covariance.h"

#include "estimate/marginals.h"
#include "init/orb/bundle/reprojection_equations.h"
#include "init/orb/bundle/robust_adjustment.h"

#include <cmath>
#include <limits>
#include <utility>
#include <vector>

namespace dsorb::init_orb {
namespace {

/// Relative growth of the factor on the clustered covariance per unit by which the tails of the
/// errors exceed a Gaussian's [-].
/// @source docs/experiments.md, "Variances of depths and poses"
constexpr double kTailVarianceFactor = 4;

/// Gradient of the cost by the poses, summed over the corners of each cell, one column a cell: they
/// are independent samples of an error whose covariance is unknown.
Eigen::MatrixXd cellGradients(const InitialMap& map,
                              const LinearSystem<double>& system,
                              const PoseRows& pose_rows,
                              const PinholeCamera& camera,
                              const GeometricOptions& options) {
  std::vector<Eigen::Index> column(static_cast<std::size_t>(kCellsX * kCellsY), -1);
  std::vector<std::size_t> cell(map.corners.size());
  Eigen::Index cells = 0;
  for (std::size_t i = 0; i < cell.size(); ++i) {
    cell[i] = imageCell(map.corners[i].pixel, camera);
    if (column[cell[i]] < 0) column[cell[i]] = cells++;
  }
  Eigen::MatrixXd gradients = Eigen::MatrixXd::Zero(pose_rows.size, cells);
  for (const CornerObservation& observation : map.observations) {
    const auto frame = observation.frame;
    const auto corner = observation.corner;
    if (pose_rows.first[frame] < 0) continue;
    const auto projection = projectCorner(map, camera, observation);
    if (!projection) continue;
    const Eigen::Matrix2d whitening = observation.whitening / options.sigma;
    const Eigen::Vector2d error = whitening * (projection->pixel - observation.pixel);
    gradients.col(column[cell[corner]]).segment<kPoseSize>(pose_rows.first[frame]) +=
        robustWeight(error.norm(), options) * projection->J_pose.transpose() *
        (whitening.transpose() * error);
  }
  for (std::size_t i = 0; i < cell.size(); ++i) {
    gradients.col(column[cell[i]]) -=
        system.couplingOf(i) * (system.depth_gradient[i] / system.depth_hessian[i]);
  }
  return gradients;
}

void setPoseCovariances(InitialMap& map, const PoseRows& pose_rows, const Eigen::MatrixXd& joint) {
  std::vector<std::size_t> frames;
  for (std::size_t k = 1; k < map.frames.size(); ++k) {
    map.frames[k].covariance.reset();
    if (pose_rows.first[k] >= 0) frames.push_back(k);
  }
  setJointCovariance(map, std::move(frames), joint);
}

}  // namespace

double setCovariances(InitialMap& map,
                      const PinholeCamera& camera,
                      const GeometricOptions& options) {
  const GeometricMarginals joint(map, camera, options);
  if (!joint.variance_factor) return std::numeric_limits<double>::quiet_NaN();
  const PoseRows& pose_rows = joint.rows;
  const LinearSystem<double>& system = joint.equations.system;
  const Marginals& marginals = joint.marginals;
  const int size = pose_rows.size;
  const double factor = *joint.variance_factor;
  const bool formal = options.pose_variance_factor <= 0;
  // Errors of one track in all frames are one error.
  const double depth_only_factor = formal ? factor : factor * size / kPoseSize;
  // Columns r with sum of r r^T = covariance of the poses, before the gauge.
  Eigen::MatrixXd roots = std::sqrt(factor) * marginals.roots();
  if (!formal) {
    map.cluster_variance_scale =
        options.pose_variance_factor * (1 + kTailVarianceFactor * tailExcess(map, camera));
    const Eigen::MatrixXd clustered = marginals.clusteredRoots(
        cellGradients(map, system, pose_rows, camera, options), size / kPoseSize);
    roots.conservativeResize(Eigen::NoChange, size + clustered.cols());
    roots.rightCols(clustered.cols()) = std::sqrt(map.cluster_variance_scale) * clustered;
  }
  const double mean_variance = marginals.depthVariance();
  const Eigen::MatrixXd in_gauge = marginals.inGauge(roots);
  setPoseCovariances(map,
                     pose_rows,
                     in_gauge * in_gauge.transpose() +
                         depth_only_factor * mean_variance * joint.scale * joint.scale.transpose());
  Eigen::VectorXd effect(size);
  for (std::size_t i = 0; i < map.corners.size(); ++i) {
    const double rho = map.corners[i].inverse_depth;
    marginals.depthEffect(system, i, rho, effect);
    map.corners[i].variance = depth_only_factor * marginals.ownVariance(system, i, rho) +
                              (roots.transpose() * effect).squaredNorm();
  }
  return factor;
}

}  // namespace dsorb::init_orb
