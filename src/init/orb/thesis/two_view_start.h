// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "init/orb/map/attempt_types.h"

namespace dsorb::init_orb {

/// Poses and corners from two views: homography against fundamental matrix between the reference
/// and the newest frame, then the poses of the frames between.
/// @source [Gladkova], section 3.2
Outcome<Reconstruction> startFromTwoViews(const ReferenceView& view, const AttemptContext& context);

/// Adjusts poses and corners of such a start.
Outcome<Reconstruction> adjustCorners(Reconstruction made, const AttemptContext& context);

}  // namespace dsorb::init_orb
