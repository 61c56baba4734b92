// SPDX-License-Identifier: BSD-3-Clause
#pragma once

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

}  // namespace dsorb::init_orb
