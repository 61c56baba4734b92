// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "init/orb/map/initial_map.h"

#include <vector>

namespace dsorb::init_orb {

/// Sets the brightness of every posed frame after the reference: gain and offset between the grey
/// values around the corners in the reference and where they are seen, by a robust line through the
/// patch means. A frame with too few corners or too little contrast keeps a = b = 0.
/// @source Engel et al., DSO, arXiv:1607.02565, eq. (4) for the meaning of a and b
void estimateBrightness(InitialMap& map, const PinholeCamera& camera);

/// Sets the brightness of some frames only. @param frames indices without the reference
void estimateBrightness(InitialMap& map,
                        const PinholeCamera& camera,
                        const std::vector<std::size_t>& frames);

}  // namespace dsorb::init_orb
