// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/geometry/se3.h"

namespace dsorb {

/// Relative pose of two cameras, as estimated first and as known now.
struct CorrectedMotion {
  SE3 T_second_first_then;
  SE3 T_second_first_now;
};

/// Pose of a camera between two others whose relative pose was corrected since. The correction of
/// scale and direction acts on its position as a whole, about the first camera: an initializer errs
/// in them alike for all its frames. The correction of the second camera's rotation grows from none
/// to all on the way.
/// @param T_cam_first  as estimated together with `then`
/// @param progress     of the camera on the way from the first to the second, 0 to 1
/// @return             T_cam_first in the unit of `now`
/// @source derived in reattachment_test
[[nodiscard]] SE3 reattach(const SE3& T_cam_first, const CorrectedMotion& motion, double progress);

/// The same for a camera that was tracked against the first one, as the second one was: errors of
/// tracking grow on the way, so the whole correction does.
/// @param T_cam_first  as tracked
[[nodiscard]] SE3 spreadCorrection(const SE3& T_cam_first,
                                   const CorrectedMotion& motion,
                                   double progress);

}  // namespace dsorb
