// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "init/orb/map/attempt_types.h"

namespace dsorb::init_orb {

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
