// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/geometric_covariance.h"

#include "init/orb/reprojection_equations.h"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>
#include <limits>

namespace dsorb::init_orb {
namespace {

/// Direction in which all translations grow together: it leaves every projection unchanged.
Eigen::VectorXd scaleDirection(const InitialMap& map, const PoseRows& pose_rows) {
  Eigen::VectorXd direction = Eigen::VectorXd::Zero(pose_rows.size);
  for (std::size_t k = 1; k < map.frames.size(); ++k) {
    if (pose_rows.first[k] >= 0) {
      direction.segment<3>(pose_rows.first[k]) = map.T_cam_ref[k]->translation();
    }
  }
  return direction;
}

/// Factors on formal variances.
struct Inflation {
  double pose = 1;
  double own = 1;            ///< of an inverse depth, poses known
  double depth_by_pose = 1;  ///< of an inverse depth, by the poses' errors
};

/// As if all observations of n corners in F frames carried the information of `effective_points`
/// of one frame.
/// @source measured on TartanAir and EuRoC starts: F n / 50 for poses, F for an inverse depth's own
///         part, half of the poses' factor for the rest
Inflation inflationOf(int frames, Eigen::Index corners, double effective_points) {
  if (effective_points <= 0) {
    return {};
  }
  const double pose = frames * static_cast<double>(corners) / effective_points;
  return {std::max(1.0, pose), static_cast<double>(frames), std::max(1.0, 0.5 * pose)};
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
  const Inflation inflation = inflationOf(size / kPoseSize, corners, options.effective_points);

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
  const Eigen::MatrixXd root = cholesky.matrixL().solve(projector.transpose());
  const Eigen::MatrixXd poses =
      inflation.pose * factor *
      (root.transpose() * root + mean_variance * scale * scale.transpose());
  map.joint_covariance = poses;
  for (std::size_t k = 1; k < map.frames.size(); ++k) {
    map.covariance[k].reset();
    if (pose_rows.first[k] >= 0) {
      map.covariance[k] = poses.block<kPoseSize, kPoseSize>(pose_rows.first[k], pose_rows.first[k]);
    }
  }
  Eigen::VectorXd inverse_depths(corners);
  for (Eigen::Index i = 0; i < corners; ++i) {
    inverse_depths[i] = map.corners[static_cast<std::size_t>(i)].inverse_depth;
  }
  Eigen::MatrixXd gauge_free = coupling - mean_coupling * inverse_depths.transpose();
  cholesky.matrixL().solveInPlace(gauge_free);
  for (Eigen::Index i = 0; i < corners; ++i) {
    const double rho = inverse_depths[i];
    const double from_poses = gauge_free.col(i).squaredNorm() + rho * rho * mean_variance;
    map.corners[static_cast<std::size_t>(i)].variance =
        factor * (inflation.own * own[i] * std::max(0.0, 1.0 - 2.0 * rho / n) +
                  inflation.depth_by_pose * from_poses);
  }
  return factor;
}

}  // namespace dsorb::init_orb
