// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "init/orb/map/attempt_types.h"

namespace dsorb::init_orb {

/// Fills a start up to a dense one: the corners and the poses they were adjusted with seed a window
/// with their covariances as its prior, pixels of the reference are searched in its frames, those
/// that agree with their neighbours become points, and one adjustment of the window finds poses,
/// brightness and depths together.
/// @param start corners with variances, adjusted frames with their joint covariance
/// @return      the same map with the window's poses and depths; corners that contradict their
///              neighbours or the images are gone
Outcome<Reconstruction> adjustFirstWindow(Reconstruction start, const AttemptContext& context);

}  // namespace dsorb::init_orb
