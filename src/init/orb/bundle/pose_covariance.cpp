// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/bundle/pose_covariance.h"

#include "estimate/warp.h"
#include "init/orb/bundle/reprojection_equations.h"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cstddef>

namespace dsorb::init_orb {

InheritedPoseError::InheritedPoseError(const InitialMap& map,
                                       const PinholeCamera& camera,
                                       const GeometricOptions& options)
    : joint_(map.joint_covariance) {
  const PoseRows rows(map, map.joint_frames);
  const LinearSystem<double> system = linearize(map, rows, camera, options).system;
  const auto corners = static_cast<Eigen::Index>(map.corners.size());
  // Rows 6 d to 6 d + 5: J^T J_t,d / (rho h).
  Eigen::Matrix<double, 18, Eigen::Dynamic> effects =
      Eigen::Matrix<double, 18, Eigen::Dynamic>::Zero(18, corners);
  Matrix6d hessian = Matrix6d::Zero();
  for (Eigen::Index i = 0; i < corners; ++i) {
    const Corner& corner = map.corners[static_cast<std::size_t>(i)];
    const auto k = static_cast<std::size_t>(i);
    if (!system.known(k) || !(corner.inverse_depth > 0)) continue;
    const auto projection =
        projectHosted(camera, SE3(), camera.unproject(corner.pixel), corner.inverse_depth);
    const Matrix6d own = projection->J_pose.transpose() * projection->J_pose;
    hessian += own;
    const double scale = 1 / (corner.inverse_depth * system.depth_hessian[k]);
    for (Eigen::Index d = 0; d < 3; ++d) effects.col(i).segment<6>(6 * d) = scale * own.col(d);
  }
  const Eigen::Matrix<double, 18, Eigen::Dynamic> sums =
      effects * system.couplings().topRows(corners);
  const Eigen::LDLT<Matrix6d> cholesky(hessian);
  for (Eigen::Index d = 0; d < 3; ++d) {
    response_[static_cast<std::size_t>(d)] = cholesky.solve(sums.middleRows<6>(6 * d));
  }
}

Eigen::Matrix<double, 6, Eigen::Dynamic> InheritedPoseError::response(const SE3& T_cam_ref) const {
  const Eigen::Matrix3d R = T_cam_ref.unitQuaternion().toRotationMatrix();
  const Eigen::Vector3d t = R.transpose() * T_cam_ref.translation();
  Eigen::Matrix<double, 6, Eigen::Dynamic> response =
      t.x() * response_[0] + t.y() * response_[1] + t.z() * response_[2];
  response.topRows<3>() = (R * response.topRows<3>()).eval();
  response.bottomRows<3>() = (R * response.bottomRows<3>()).eval();
  return response;
}

Matrix6d InheritedPoseError::covariance(const SE3& T_cam_ref) const {
  const Eigen::Matrix<double, 6, Eigen::Dynamic> inherited = response(T_cam_ref);
  const Matrix6d covariance = inherited * joint_ * inherited.transpose();
  return 0.5 * (covariance + covariance.transpose());
}

Matrix6d interpolatedCovariance(const InitialMap& map, std::size_t frame) {
  const auto after = std::upper_bound(map.joint_frames.begin(), map.joint_frames.end(), frame);
  const std::size_t last = *after;
  Matrix6d covariance = map.frames[last].covariance.value_or(Matrix6d::Zero());
  SE3 T_before;
  if (after != map.joint_frames.begin()) {
    const std::size_t first = *(after - 1);
    T_before = *map.frames[first].T_cam_ref;
    covariance += map.frames[first].covariance.value_or(Matrix6d::Zero());
  }
  const Vector6d motion = (*map.frames[last].T_cam_ref * T_before.inverse()).log();
  covariance.diagonal().head<3>().array() += 0.25 * motion.head<3>().squaredNorm();
  covariance.diagonal().tail<3>().array() += 0.25 * motion.tail<3>().squaredNorm();
  return covariance;
}

}  // namespace dsorb::init_orb
