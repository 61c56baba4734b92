// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "track/tracking_reference.h"

#include <vector>

namespace dsorb::track {

inline TrackingReference referenceOf(const FramePtr& frame,
                                     const PinholeCamera& camera,
                                     const std::vector<DepthSample>& samples,
                                     const AffineBrightness& affine = {}) {
  TrackingReference reference{frame, camera, affine};
  TrackingReferenceBuilder(camera).fill(samples, reference);
  return reference;
}

}  // namespace dsorb::track
