// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/reprojection_equations.h"

#include "camera/reprojection.h"

#include <cmath>
#include <cstddef>

namespace dsorb::init_orb {
namespace {

bool isKept(const std::vector<char>& kept, int corner) {
  return kept.empty() || kept[static_cast<std::size_t>(corner)] != 0;
}

/// Derivative of the robust loss by half the squared error.
/// @param error whitened, at least 0
double robustWeight(double error, const GeometricOptions& options) {
  const double limit = options.loss_threshold;
  if (options.loss == RobustLoss::kHuber) return error > limit ? limit / error : 1.0;
  return 1.0 / (1.0 + error * error / (limit * limit));
}

std::optional<HostedProjection> project(const InitialMap& map,
                                        const Observation& observation,
                                        const PinholeCamera& camera) {
  const Corner& corner = map.corners[static_cast<std::size_t>(observation.corner)];
  return projectHosted(camera,
                       *map.T_cam_ref[static_cast<std::size_t>(observation.frame)],
                       camera.unproject(corner.pixel),
                       corner.inverse_depth);
}

}  // namespace

double robustCost(double error, const GeometricOptions& options) {
  const double limit = options.loss_threshold;
  if (options.loss == RobustLoss::kHuber) {
    return error <= limit ? 0.5 * error * error : limit * error - 0.5 * limit * limit;
  }
  return 0.5 * limit * limit * std::log1p(error * error / (limit * limit));
}

PoseRows::PoseRows(const InitialMap& map) : first(map.frames.size(), -1) {
  for (std::size_t k = 1; k < map.frames.size(); ++k) {
    if (map.T_cam_ref[k]) {
      first[k] = size;
      size += kPoseSize;
    }
  }
}

ReprojectionEquations linearize(const InitialMap& map,
                                const std::vector<char>& kept,
                                const PoseRows& pose_rows,
                                const PinholeCamera& camera,
                                const GeometricOptions& options) {
  const int size = pose_rows.size;
  const auto corners = static_cast<Eigen::Index>(map.corners.size());
  ReprojectionEquations system{Eigen::MatrixXd::Zero(size, size),
                               Eigen::MatrixXd::Zero(size, corners),
                               Eigen::VectorXd::Zero(corners),
                               Eigen::VectorXd::Zero(size),
                               Eigen::VectorXd::Zero(corners)};
  for (const Observation& observation : map.observations) {
    const int row = pose_rows.first[static_cast<std::size_t>(observation.frame)];
    if (row < 0 || !isKept(kept, observation.corner)) {
      continue;
    }
    const std::optional<HostedProjection> projection = project(map, observation, camera);
    if (!projection) {
      continue;
    }
    const Eigen::Matrix2d whitening = observation.whitening / options.sigma;
    const Eigen::Vector2d residual = whitening * (projection->pixel - observation.pixel);
    const Eigen::Matrix<double, 2, kPoseSize> J_pose = whitening * projection->J_pose;
    const Eigen::Vector2d J_depth = whitening * projection->J_inverse_depth;
    const double weight = robustWeight(residual.norm(), options);
    const Eigen::Matrix<double, kPoseSize, 2> weighted = weight * J_pose.transpose();
    system.pose_hessian.block<kPoseSize, kPoseSize>(row, row) += weighted.lazyProduct(J_pose);
    system.coupling.col(observation.corner).segment<kPoseSize>(row) +=
        weighted.lazyProduct(J_depth);
    system.pose_gradient.segment<kPoseSize>(row) += weighted.lazyProduct(residual);
    system.depth_hessian[observation.corner] += weight * J_depth.squaredNorm();
    system.depth_gradient[observation.corner] += weight * J_depth.dot(residual);
    system.weighted_error += weight * residual.squaredNorm();
    system.rows += 2;
  }
  return system;
}

std::optional<double> reprojectionCost(const InitialMap& map,
                                       const std::vector<char>& kept,
                                       const PinholeCamera& camera,
                                       const GeometricOptions& options) {
  double cost = 0;
  for (const Observation& observation : map.observations) {
    if (!map.T_cam_ref[static_cast<std::size_t>(observation.frame)] ||
        !isKept(kept, observation.corner)) {
      continue;
    }
    const std::optional<HostedProjection> projection = project(map, observation, camera);
    if (!projection) {
      return std::nullopt;
    }
    const Eigen::Vector2d error = observation.whitening * (projection->pixel - observation.pixel);
    cost += robustCost(error.norm() / options.sigma, options);
  }
  return std::isfinite(cost) ? std::optional(cost) : std::nullopt;
}

}  // namespace dsorb::init_orb
