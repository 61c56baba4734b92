// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/geometry/se3.h"

#include "init/orb/map/initial_map.h"

#include <Eigen/Core>

#include <vector>

namespace dsorb::init_orb {

/// Normal equations of known motions, poses' left increments in six rows each. They are Gaussians,
/// because adjustWithMotions() refuses those that contradict the images. Known translations are in
/// metres and the map is not: the metres of a unit are eliminated at their best value, so that the
/// equations say nothing of the map's scale.
struct MotionEquations {
  Eigen::MatrixXd H;
  Eigen::VectorXd b;
  double cost = 0;    ///< half the squared, whitened errors
  double metres = 0;  ///< of a unit, at least 0 [m]; 0 where no translation is known
  int rows = 0;       ///< errors, less one for the scale
};

/// @param motions   indices into the poses; from KnownMotion::kReference: the reference
/// @param T_cam_ref poses in the map's unit
MotionEquations motionEquations(const std::vector<KnownMotion>& motions,
                                const std::vector<SE3>& T_cam_ref);

}  // namespace dsorb::init_orb
