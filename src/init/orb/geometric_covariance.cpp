// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/geometric_covariance.h"

#include "camera/reprojection.h"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>
#include <limits>

namespace dsorb::init_orb {
namespace {

constexpr int kPoseSize = 6;

/// Which six rows of the pose system belong to a frame; -1 for the reference and unposed frames.
std::vector<int> poseRows(const InitialMap& map, int* size) {
  std::vector<int> rows(map.frames.size(), -1);
  *size = 0;
  for (std::size_t k = 1; k < map.frames.size(); ++k) {
    if (map.T_cam_ref[k]) {
      rows[k] = *size;
      *size += kPoseSize;
    }
  }
  return rows;
}

/// Normal equations of poses and inverse depths; the pose block is block diagonal.
struct NormalEquations {
  Eigen::MatrixXd schur;          ///< pose system with the inverse depths eliminated
  Eigen::MatrixXd coupling;       ///< column i: h_i / h_ii
  Eigen::VectorXd depth_hessian;  ///< h_ii
  double weighted_error = 0;      ///< sum of w e^2
  int rows = 0;                   ///< scalar observations
};

NormalEquations accumulate(const InitialMap& map,
                           const PinholeCamera& camera,
                           const GeometricOptions& options,
                           const std::vector<int>& pose_rows,
                           int size) {
  const auto corners = static_cast<Eigen::Index>(map.corners.size());
  NormalEquations system{Eigen::MatrixXd::Zero(size, size),
                         Eigen::MatrixXd::Zero(size, corners),
                         Eigen::VectorXd::Zero(corners)};
  for (const Observation& observation : map.observations) {
    const int row = pose_rows[static_cast<std::size_t>(observation.frame)];
    if (row < 0) {
      continue;
    }
    const Corner& corner = map.corners[static_cast<std::size_t>(observation.corner)];
    const SE3& T = *map.T_cam_ref[static_cast<std::size_t>(observation.frame)];
    const std::optional<HostedProjection> projection =
        projectHosted(camera, T, camera.unproject(corner.pixel), corner.inverse_depth);
    if (!projection) {
      continue;
    }
    const double error = (projection->pixel - observation.pixel).norm() / options.sigma;
    const double robust = error > options.huber_threshold ? options.huber_threshold / error : 1.0;
    const double weight = robust / (options.sigma * options.sigma);
    system.schur.block<kPoseSize, kPoseSize>(row, row).noalias() +=
        weight * projection->J_pose.transpose() * projection->J_pose;
    system.coupling.col(observation.corner).segment<kPoseSize>(row).noalias() +=
        weight * projection->J_pose.transpose() * projection->J_inverse_depth;
    system.depth_hessian[observation.corner] += weight * projection->J_inverse_depth.squaredNorm();
    system.weighted_error += robust * error * error;
    system.rows += 2;
  }
  const Eigen::MatrixXd unscaled = system.coupling;
  system.coupling.array().rowwise() /= system.depth_hessian.transpose().array();
  system.schur.noalias() -= unscaled * system.coupling.transpose();
  return system;
}

/// Direction in which all translations grow together: it leaves every projection unchanged.
Eigen::VectorXd scaleDirection(const InitialMap& map, const std::vector<int>& pose_rows, int size) {
  Eigen::VectorXd direction = Eigen::VectorXd::Zero(size);
  for (std::size_t k = 1; k < map.frames.size(); ++k) {
    if (pose_rows[k] >= 0) {
      direction.segment<3>(pose_rows[k]) = map.T_cam_ref[k]->translation();
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
  int size = 0;
  const std::vector<int> pose_rows = poseRows(map, &size);
  const auto corners = static_cast<Eigen::Index>(map.corners.size());
  const NormalEquations system = accumulate(map, camera, options, pose_rows, size);
  const auto redundancy = static_cast<double>(system.rows - size - corners + 1);
  if (size == 0 || redundancy <= 0 || !(system.depth_hessian.minCoeff() > 0)) {
    return kDegenerate;
  }
  const double factor = system.weighted_error / redundancy;
  const Inflation inflation = inflationOf(size / kPoseSize, corners, options.effective_points);

  // The null direction gets the mean stiffness of the others; what it gets does not matter.
  const Eigen::VectorXd scale = scaleDirection(map, pose_rows, size);
  const Eigen::VectorXd unit_scale = scale.normalized();
  const Eigen::LLT<Eigen::MatrixXd> cholesky(
      system.schur + system.schur.trace() / size * unit_scale * unit_scale.transpose());
  if (cholesky.info() != Eigen::Success) {
    return kDegenerate;
  }
  const Eigen::VectorXd own = system.depth_hessian.cwiseInverse();
  const auto n = static_cast<double>(corners);
  const double mean_variance = own.sum() / (n * n);
  const Eigen::VectorXd mean_coupling = system.coupling.rowwise().mean();
  const Eigen::MatrixXd projector =
      Eigen::MatrixXd::Identity(size, size) - scale * mean_coupling.transpose();
  const Eigen::MatrixXd root = cholesky.matrixL().solve(projector.transpose());
  const Eigen::MatrixXd poses =
      inflation.pose * factor *
      (root.transpose() * root + mean_variance * scale * scale.transpose());
  for (std::size_t k = 1; k < map.frames.size(); ++k) {
    map.covariance[k].reset();
    if (pose_rows[k] >= 0) {
      map.covariance[k] = poses.block<kPoseSize, kPoseSize>(pose_rows[k], pose_rows[k]);
    }
  }
  Eigen::VectorXd inverse_depths(corners);
  for (Eigen::Index i = 0; i < corners; ++i) {
    inverse_depths[i] = map.corners[static_cast<std::size_t>(i)].inverse_depth;
  }
  Eigen::MatrixXd gauge_free = system.coupling - mean_coupling * inverse_depths.transpose();
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
