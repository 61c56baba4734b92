// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "init/orb/map/attempt_types.h"

namespace dsorb::init_orb {

/// Semi-dense inverse depths of the reference, without what moves by itself.
Outcome<Reconstruction> addSemiDense(Reconstruction made,
                                     const ReferenceView& view,
                                     const AttemptContext& context);

/// Photometric adjustment, outlier filter and second adjustment, as the options want them.
Outcome<Reconstruction> adjustImages(Reconstruction made, const AttemptContext& context);

/// Poses the frames that had no part in the adjustments.
Outcome<Reconstruction> poseOtherFrames(Reconstruction made, const AttemptContext& context);

}  // namespace dsorb::init_orb
