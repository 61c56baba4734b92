// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "init/orb/map/attempt_types.h"

#include <Eigen/Core>

#include <vector>

namespace dsorb::init_orb {

/// Disagreement of each inverse depth with its neighbours in the image: the 35 % quantile of the
/// absolute differences of log inverse depth to the 7 nearest points within a radius, so that the
/// neighbours on its own side of a depth edge are enough. It is 0 with fewer than 3 neighbours.
/// @param pixels         one a point [px]
/// @param inverse_depths one a point; not positive: infinite disagreement [1/unit]
/// @param radius         [px]
std::vector<double> neighbourDisagreement(const std::vector<Eigen::Vector2f>& pixels,
                                          const std::vector<double>& inverse_depths,
                                          float radius);

/// Fills a start up to a dense one with the engine's own tools: corners and the frames that they
/// were adjusted with seed a window, pixels of the reference are searched in its frames, and those
/// of which the images say enough and that agree with their neighbours become points.
///
/// Poses and corners stay as the corners' adjustment has them: an adjustment of this window would
/// make the trajectory worse (1.06 +- .03) and no depth better (1.02 +- .02 of the error); the
/// covariances of the poses are the window's prior and enter the variances of all points.
/// @param start corners with variances, adjusted frames with their joint covariance
/// @return      the same map with points; corners that contradict their neighbours or the images
///              are gone
Outcome<Reconstruction> fillFirstWindow(Reconstruction start, const AttemptContext& context);

}  // namespace dsorb::init_orb
