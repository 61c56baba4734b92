// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include <vector>

namespace dsorb::init_orb {

/// How far each inverse depth is from what its neighbours in the image say: the 35 % quantile of
/// the absolute differences of log inverse depth to the 7 nearest within 60 px, so that a point on
/// the smaller side of a depth edge has company enough. 0 with fewer than 3 neighbours.
/// @param pixels         one a point [px]
/// @param inverse_depths one a point; not positive: infinite disagreement [1/unit]
std::vector<double> neighbourDisagreement(const std::vector<Eigen::Vector2f>& pixels,
                                          const std::vector<double>& inverse_depths);

}  // namespace dsorb::init_orb
