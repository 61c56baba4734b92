// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/photometric/pose_combination.h"

#include <Eigen/Cholesky>

#include <cmath>

namespace dsorb::init_orb {

CombinedPoses combinePoses(const InitialMap& map,
                           const PhotometricProblem& problem,
                           const std::vector<SE3>& photometric,
                           const Eigen::MatrixXd& covariance) {
  const std::vector<Eigen::Index> rows = jointRows(map, problem);
  Eigen::VectorXd difference(covariance.rows());
  for (std::size_t f = 0; f < photometric.size(); ++f) {
    const std::size_t frame = problem.frames[f].index;
    difference.segment<6>(static_cast<Eigen::Index>(6 * f)) =
        (photometric[f] * map.frames[frame].T_cam_ref->inverse()).log();
  }
  const Eigen::MatrixXd spread = map.joint_covariance(rows, rows) + covariance;
  const Eigen::VectorXd weighted = spread.ldlt().solve(difference);
  const Eigen::VectorXd step =
      map.joint_covariance(Eigen::seqN(0, map.joint_covariance.rows()), rows) * weighted;
  CombinedPoses combined;
  for (std::size_t i = 0; i < map.joint_frames.size(); ++i) {
    combined.T_cam_ref.push_back(SE3::exp(step.segment<6>(static_cast<Eigen::Index>(6 * i))) *
                                 *map.frames[map.joint_frames[i]].T_cam_ref);
  }
  combined.distance = std::sqrt(difference.dot(weighted) / static_cast<double>(difference.size()));
  return combined;
}

}  // namespace dsorb::init_orb
