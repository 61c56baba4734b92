// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "init/orb/map/attempt_types.h"

namespace dsorb::init_orb {

/// Poses and corners by information: essential matrix, robust adjustment of a few frames, a gate on
/// the predicted error of the direction of translation, the tracks' noise measured, corners
/// measured again with warped patches.
/// @param attempt gets the map, or the reason why there is none; and its share of the report. Only
///                the adjusted frames are posed: the others wait for poseOtherFrames
/// @return whether the map is usable
bool estimateInformedMotion(const ReferenceView& view,
                            const AttemptContext& context,
                            Attempt& attempt);

}  // namespace dsorb::init_orb
