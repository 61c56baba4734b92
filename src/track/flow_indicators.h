// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/geometry/se3.h"

#include "track/tracking_reference.h"

namespace dsorb::track {

/// Mean squared image motion of the reference points, by translation alone and by the full motion.
struct FlowIndicators {
  double translation = 0;  ///< [px^2]
  double full = 0;         ///< [px^2]
};

/// Every 32nd point is projected with +t and -t. A point that passes the camera plane is left out;
/// one displacement counts at most the image diagonal.
/// @param camera of level 0, like the points
/// @source front end of DSO as published, with bounds on degenerate points
[[nodiscard]] FlowIndicators flowIndicators(const ReferencePoints& points,
                                            const PinholeCamera& camera,
                                            const SE3& T_cur_ref);

}  // namespace dsorb::track
