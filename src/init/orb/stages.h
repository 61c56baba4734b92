// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "init/orb/map/attempt_types.h"

namespace dsorb::init_orb {

/// Adds semi-dense inverse depths of the reference, leaving out regions that move by themselves.
Outcome<Reconstruction> addSemiDense(Reconstruction made,
                                     const ReferenceView& view,
                                     const AttemptContext& context);

/// Runs the photometric adjustment, the outlier filter and the second adjustment that the options
/// ask for.
Outcome<Reconstruction> adjustImages(Reconstruction made, const AttemptContext& context);

/// Poses the frames that had no part in the adjustments.
Outcome<Reconstruction> poseOtherFrames(Reconstruction made, const AttemptContext& context);

}  // namespace dsorb::init_orb
