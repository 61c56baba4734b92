// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/bundle/geometric_covariance.h"

#include "init/orb/bundle/reprojection_equations.h"
#include "init/orb/bundle/robust_adjustment.h"
#include "init/orb/map/image_cells.h"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

namespace dsorb::init_orb {
namespace {

/// What the factor on the clustered covariance grows by, as a share of itself, where the errors'
/// tails are in excess by 1 [-]. With 1 and 4 the median of error^2 over variance is .45 and .49
/// (rotation, direction) over 18 rendered sequences, .15 to 1.6 on each; .55, .51 on TartanAir and
/// .37, .34 on room_hand.
constexpr double kTailVarianceFactor = 4;

/// What the corners of each cell leave of the gradient for the poses, one column a cell:
/// independent samples of an error whose covariance is unknown.
Eigen::MatrixXd cellGradients(const InitialMap& map,
                              const ReprojectionEquations& system,
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
    const auto k = static_cast<Eigen::Index>(i);
    gradients.col(column[cell[i]]) -=
        system.coupling.col(k) * (system.depth_gradient[k] / system.depth_hessian[k]);
  }
  const auto free = static_cast<double>(cells) - static_cast<double>(pose_rows.size) / kPoseSize;
  return gradients * std::sqrt(static_cast<double>(cells) / std::max(free, 1.0));
}

void setPoseCovariances(InitialMap& map, const PoseRows& pose_rows, const Eigen::MatrixXd& joint) {
  std::vector<int> frames;
  for (std::size_t k = 1; k < map.frames.size(); ++k) {
    map.frames[k].covariance.reset();
    if (pose_rows.first[k] >= 0) frames.push_back(static_cast<int>(k));
  }
  setJointCovariance(map, std::move(frames), joint);
}

Eigen::VectorXd inverseDepths(const InitialMap& map) {
  Eigen::VectorXd inverse_depths(static_cast<Eigen::Index>(map.corners.size()));
  for (Eigen::Index i = 0; i < inverse_depths.size(); ++i) {
    inverse_depths[i] = map.corners[static_cast<std::size_t>(i)].inverse_depth;
  }
  return inverse_depths;
}

}  // namespace

double setCovariances(InitialMap& map,
                      const PinholeCamera& camera,
                      const GeometricOptions& options) {
  constexpr double kDegenerate = std::numeric_limits<double>::quiet_NaN();
  const PoseRows pose_rows(map);
  const int size = pose_rows.size;
  const auto corners = static_cast<Eigen::Index>(map.corners.size());
  const ReprojectionEquations system = linearize(map, {}, pose_rows, camera, options);
  const auto redundancy = static_cast<double>(system.rows - size - corners + 1);
  if (size == 0 || redundancy <= 0 || !(system.depth_hessian.minCoeff() > 0)) {
    return kDegenerate;
  }
  const double factor = system.weighted_error / redundancy;
  const bool formal = options.pose_variance_factor <= 0;
  // Errors of one track in all frames are one error.
  const double own_factor = formal ? factor : factor * size / kPoseSize;

  const Eigen::VectorXd own = system.depth_hessian.cwiseInverse();
  const Eigen::MatrixXd coupling = system.coupling * own.asDiagonal();
  const Eigen::MatrixXd schur = system.pose_hessian - system.coupling * coupling.transpose();
  // The null direction gets the mean stiffness of the others; what it gets does not matter.
  const Eigen::VectorXd scale = scaleDirection(map, pose_rows);
  const Eigen::VectorXd unit_scale = scale.normalized();
  const Eigen::LLT<Eigen::MatrixXd> cholesky(schur + schur.trace() / size * unit_scale *
                                                         unit_scale.transpose());
  if (cholesky.info() != Eigen::Success) {
    return kDegenerate;
  }
  const auto n = static_cast<double>(corners);
  const double mean_variance = own.sum() / (n * n);
  const Eigen::VectorXd mean_coupling = coupling.rowwise().mean();
  const Eigen::MatrixXd projector =
      Eigen::MatrixXd::Identity(size, size) - scale * mean_coupling.transpose();
  // Columns r with sum of r r^T = covariance of the poses, before the gauge.
  Eigen::MatrixXd roots =
      std::sqrt(factor) * cholesky.matrixU().solve(Eigen::MatrixXd::Identity(size, size));
  if (!formal) {
    map.clustered_factor =
        options.pose_variance_factor * (1 + kTailVarianceFactor * tailExcess(map, camera));
    const Eigen::MatrixXd cells =
        std::sqrt(map.clustered_factor) * cellGradients(map, system, pose_rows, camera, options);
    roots.conservativeResize(Eigen::NoChange, size + cells.cols());
    roots.rightCols(cells.cols()) = cholesky.solve(cells);
  }
  const Eigen::MatrixXd in_gauge = projector * roots;
  const Eigen::MatrixXd poses =
      in_gauge * in_gauge.transpose() + own_factor * mean_variance * scale * scale.transpose();
  setPoseCovariances(map, pose_rows, poses);
  const Eigen::VectorXd inverse_depths = inverseDepths(map);
  const Eigen::MatrixXd by_pose =
      roots.transpose() * (coupling - mean_coupling * inverse_depths.transpose());
  for (Eigen::Index i = 0; i < corners; ++i) {
    const double rho = inverse_depths[i];
    map.corners[static_cast<std::size_t>(i)].variance =
        own_factor * (own[i] * std::max(0.0, 1.0 - 2.0 * rho / n) + rho * rho * mean_variance) +
        by_pose.col(i).squaredNorm();
  }
  return factor;
}

}  // namespace dsorb::init_orb
