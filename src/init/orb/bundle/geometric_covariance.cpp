// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/bundle/geometric_covariance.h"

#include "estimate/marginals.h"
#include "init/orb/bundle/reprojection_equations.h"
#include "init/orb/bundle/robust_adjustment.h"
#include "init/orb/map/image_cells.h"

#include <algorithm>
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
  for (const Observation& observation : map.observations) {
    const auto frame = static_cast<std::size_t>(observation.frame);
    const auto corner = static_cast<std::size_t>(observation.corner);
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
  std::vector<int> frames;
  for (std::size_t k = 1; k < map.frames.size(); ++k) {
    map.frames[k].covariance.reset();
    if (pose_rows.first[k] >= 0) frames.push_back(static_cast<int>(k));
  }
  setJointCovariance(map, std::move(frames), joint);
}

}  // namespace

double setCovariances(InitialMap& map,
                      const PinholeCamera& camera,
                      const GeometricOptions& options) {
  constexpr double kDegenerate = std::numeric_limits<double>::quiet_NaN();
  const PoseRows pose_rows(map);
  const int size = pose_rows.size;
  const auto n = static_cast<double>(map.corners.size());
  const ReprojectionEquations equations = linearize(map, {}, pose_rows, camera, options);
  const LinearSystem<double>& system = equations.system;
  const double redundancy = equations.rows - size - n + 1;
  if (size == 0 || redundancy <= 0 || !allKnown(system, map)) return kDegenerate;
  const Eigen::VectorXd scale = scaleDirection(map, pose_rows);
  const Marginals marginals(system, scale, ReprojectionState(map, pose_rows).inverse_depth);
  if (!marginals.usable()) return kDegenerate;
  const double factor = equations.weighted_square / redundancy;
  const bool formal = options.pose_variance_factor <= 0;
  // Errors of one track in all frames are one error.
  const double own_factor = formal ? factor : factor * size / kPoseSize;
  // Columns r with sum of r r^T = covariance of the poses, before the gauge.
  Eigen::MatrixXd roots = std::sqrt(factor) * marginals.roots();
  if (!formal) {
    map.clustered_factor =
        options.pose_variance_factor * (1 + kTailVarianceFactor * tailExcess(map, camera));
    const Eigen::MatrixXd clustered = marginals.clusteredRoots(
        cellGradients(map, system, pose_rows, camera, options), size / kPoseSize);
    roots.conservativeResize(Eigen::NoChange, size + clustered.cols());
    roots.rightCols(clustered.cols()) = std::sqrt(map.clustered_factor) * clustered;
  }
  const double mean_variance = marginals.depthVariance();
  const Eigen::MatrixXd in_gauge = marginals.inGauge(roots);
  setPoseCovariances(
      map,
      pose_rows,
      in_gauge * in_gauge.transpose() + own_factor * mean_variance * scale * scale.transpose());
  Eigen::VectorXd effect(size);
  for (std::size_t i = 0; i < map.corners.size(); ++i) {
    const double rho = map.corners[i].inverse_depth;
    marginals.depthEffect(system, i, rho, effect);
    const double own = std::max(0.0, 1.0 - 2.0 * rho / n) / system.depth_hessian[i];
    map.corners[i].variance =
        own_factor * (own + rho * rho * mean_variance) + (roots.transpose() * effect).squaredNorm();
  }
  return factor;
}

}  // namespace dsorb::init_orb
