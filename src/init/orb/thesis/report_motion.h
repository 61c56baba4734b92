// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "init/orb/map/attempt_types.h"

namespace dsorb::init_orb {

/// The report's way to poses and corners: homography against fundamental matrix between the
/// reference and the newest frame, then the adjustment of all frames.
/// @param attempt gets the map, or the reason why there is none; and its share of the report
/// @return whether the map is usable
bool estimateReportMotion(const ReferenceView& view,
                          const AttemptContext& context,
                          Attempt& attempt);

/// Adjusts poses and corners of the attempt's map. @return whether it is still usable
bool adjustCorners(const AttemptContext& context, Attempt& attempt);

}  // namespace dsorb::init_orb
