// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include <vector>

namespace dsorb {

/// Similarity transform, element of Sim(3): p_a = scale * (R * p_b) + translation.
struct Similarity {
  double scale = 1;
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();

  [[nodiscard]] Eigen::Vector3d operator*(const Eigen::Vector3d& point) const {
    return scale * (rotation * point) + translation;
  }
};

/// Similarity that maps `from` onto `to` with the least sum of squared distances.
/// @param from, to corresponding points, for example camera centres, at least 3 not on one point;
///        points on one line leave the turn about it free, and any least-squares answer is returned
/// @throws std::invalid_argument on different numbers, fewer than 3 points or coinciding ones
/// @source Umeyama, Least-Squares Estimation of Transformation Parameters Between Two Point
///         Patterns, PAMI 1991, eq. (40) to (43)
[[nodiscard]] Similarity alignPoints(const std::vector<Eigen::Vector3d>& from,
                                     const std::vector<Eigen::Vector3d>& to);

/// Root mean square distance between `to` and the mapped `from`.
[[nodiscard]] double alignmentRms(const Similarity& to_from,
                                  const std::vector<Eigen::Vector3d>& from,
                                  const std::vector<Eigen::Vector3d>& to);

}  // namespace dsorb
