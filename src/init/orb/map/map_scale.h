// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "init/orb/map/initial_map.h"

namespace dsorb::init_orb {

/// Makes the mean inverse depth of the corners 1; poses, covariances and variances change their
/// unit with it.
/// @return false when that mean is not positive; nothing is changed then
bool normalizeCornerScale(InitialMap& map);

/// Does the same with the mean over corners and semi-dense points together.
bool normalizeMapScale(InitialMap& map);

}  // namespace dsorb::init_orb
