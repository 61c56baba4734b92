// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/bundle/geometric_covariance.h"

#include "estimate/variance_factors.h"
#include "init/orb/bundle/robust_adjustment.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>
#include <vector>

namespace dsorb::init_orb {
namespace {

void setPoseCovariances(InitialMap& map, const UnknownRows& rows, const Eigen::MatrixXd& joint) {
  std::vector<std::size_t> frames;
  for (std::size_t k = 1; k < map.frames.size(); ++k) {
    map.frames[k].covariance.reset();
    if (rows.first[k] >= 0) frames.push_back(k);
  }
  setJointCovariance(map, std::move(frames), joint);
}

}  // namespace

GeometricMarginals::GeometricMarginals(const InitialMap& map,
                                       const PinholeCamera& camera,
                                       const GeometricOptions& options)
    : rows(map), equations(linearize(map, rows, camera, options)) {
  const std::vector<double>& h = equations.system.depth_hessian;
  const auto last = h.begin() + static_cast<std::ptrdiff_t>(map.corners.size());
  const bool all_known = std::all_of(h.begin(), last, [](double value) { return value > 0; });
  if (rows.poses == 0 || map.corners.empty() || !all_known) return;
  scale = map.scaleKnown() ? Eigen::VectorXd::Zero(rows.size()) : rows.scaleDirection(map);
  marginals = Marginals(equations.system, scale, ReprojectionState(map, rows).inverse_depth);
  const auto unknowns = equations.system.size() + static_cast<Eigen::Index>(map.corners.size());
  const double redundancy =
      equations.rows - static_cast<double>(unknowns) + (map.scaleKnown() ? 0 : 1);
  if (marginals.usable() && redundancy > 0) {
    variance_factor = equations.weighted_square / redundancy;
  }
}

Eigen::MatrixXd cellGradients(const InitialMap& map,
                              const LinearSystem<double>& system,
                              const PinholeCamera& camera,
                              const GeometricOptions& options,
                              const AddGradient& add) {
  std::vector<Eigen::Index> column(kErrorCells, -1);
  std::vector<std::size_t> cell(map.corners.size());
  Eigen::Index cells = 0;
  for (std::size_t i = 0; i < cell.size(); ++i) {
    cell[i] = imageCell(map.corners[i].pixel, camera);
    if (column[cell[i]] < 0) column[cell[i]] = cells++;
  }
  Eigen::MatrixXd gradients = Eigen::MatrixXd::Zero(system.size(), cells);
  for (std::size_t i = 0; i < map.observations.size(); ++i) {
    const CornerObservation& observation = map.observations[i];
    if (!map.frames[observation.frame].T_cam_ref) continue;
    const auto projection = projectCorner(map, camera, observation);
    if (!projection) continue;
    const WhitenedError error(observation, *projection, options.sigma);
    const Eigen::Vector2d unwhitened =
        observation.whitening.transpose() / options.sigma * error.value;
    add(i,
        robustWeight(error.value.norm(), options) * projection->J_pose.transpose() * unwhitened,
        gradients.col(column[cell[observation.corner]]));
  }
  for (std::size_t i = 0; i < cell.size(); ++i) {
    gradients.col(column[cell[i]]) -=
        system.couplingOf(i) * (system.depth_gradient[i] / system.depth_hessian[i]);
  }
  return gradients;
}

void setCovariances(InitialMap& map,
                    const GeometricMarginals& joint,
                    const Eigen::MatrixXd& roots,
                    double own_factor) {
  const LinearSystem<double>& system = joint.equations.system;
  const Marginals& marginals = joint.marginals;
  const int size = joint.rows.poses;
  const double mean_variance = marginals.depthVariance();
  const Eigen::MatrixXd in_gauge = marginals.inGauge(roots);
  const auto poses = in_gauge.topRows(size);
  const auto scale = joint.scale.head(size);
  setPoseCovariances(
      map,
      joint.rows,
      poses * poses.transpose() + own_factor * mean_variance * scale * scale.transpose());
  Eigen::VectorXd effect(system.size());
  for (std::size_t i = 0; i < map.corners.size(); ++i) {
    const double rho = map.corners[i].inverse_depth;
    marginals.depthEffect(system, i, rho, effect);
    map.corners[i].variance = own_factor * marginals.ownVariance(system, i, rho) +
                              (roots.transpose() * effect).squaredNorm();
  }
}

double setCovariances(InitialMap& map,
                      const PinholeCamera& camera,
                      const GeometricOptions& options,
                      const Skips& skip) {
  const GeometricMarginals joint(map, camera, options);
  if (!joint.variance_factor) return std::numeric_limits<double>::quiet_NaN();
  const LinearSystem<double>& system = joint.equations.system;
  const int size = joint.rows.poses;
  const double factor = *joint.variance_factor;
  map.cluster_variance_scale = 1;
  if (!skip.has(Mechanism::kTail)) {
    map.cluster_variance_scale += variance_factors::kStartTail * tailExcess(map, camera);
  }
  Eigen::MatrixXd roots = std::sqrt(factor) * joint.marginals.roots();
  if (skip.has(Mechanism::kClusters)) {
    setCovariances(map, joint, roots, factor * size / kPoseSize);
    return factor;
  }
  const RowTimesOfMap times(map, camera);
  const auto add =
      [&](std::size_t i, const Vector6d& by_pose, const Eigen::Ref<Eigen::VectorXd>& all) {
        const CornerObservation& observation = map.observations[i];
        joint.rows.addByFactors(by_pose,
                                joint.rows.first[observation.frame],
                                times.factors(i, observation.corner),
                                map.frames[observation.frame].T_cam_ref->adjoint(),
                                all);
      };
  const Eigen::MatrixXd clustered = joint.marginals.clusteredRoots(
      cellGradients(map, system, camera, options, add), size / kPoseSize);
  roots.conservativeResize(Eigen::NoChange, roots.cols() + clustered.cols());
  roots.rightCols(clustered.cols()) = std::sqrt(map.cluster_variance_scale) * clustered;
  // Errors of one track in all frames are one error.
  setCovariances(map, joint, roots, factor * size / kPoseSize);
  return factor;
}

}  // namespace dsorb::init_orb
