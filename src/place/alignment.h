// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/geometry/similarity.h"

#include <Eigen/Core>

#include <cstddef>
#include <optional>
#include <vector>

namespace dsorb::place {

/// A point of one map where a camera of another one sees it.
struct Sight {
  Eigen::Vector3d point;        ///< in its own map
  Eigen::Vector3d uncertainty;  ///< a standard deviation of it, along its ray
  SE3 T_cam_map;                ///< of the camera, in the other map
  PinholeCamera camera;
  Eigen::Vector2d pixel;  ///< where the camera sees it [px]
  double sigma = 1;       ///< of the pixel, each axis [px]
  bool backward = false;  ///< the point is of map `a`, the camera of map `b`
};

struct Alignment {
  Similarity S_a_b;
  Matrix7d covariance;     ///< of a left increment
  std::vector<char> fits;  ///< by sight
  std::size_t inliers = 0;
  double mean_square = 0;  ///< of the inliers' errors over their standard deviations, each axis [-]
};

/// Similarity between two maps by what cameras of either see of the other's points: least squares
/// of the reprojection error, in which the points' own depths count with their variance, with
/// Cauchy's loss.
/// @param free_scale false: both have the same unit; rows of the scale are 0 in the covariance
/// @return nothing where the sights do not determine it
[[nodiscard]] std::optional<Alignment> align(const std::vector<Sight>& sights,
                                             const Similarity& guess,
                                             bool free_scale);

}  // namespace dsorb::place
