// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/calibration.h"

#include <string>
#include <vector>

namespace dsorb {

/// Refuses a lens that no camera can have.
/// @throws std::invalid_argument where the image would see more than a lens of its model can, or
///         where the distortion folds back or magnifies without measure in most of the image
void refuseImpossibleLens(const Lens& lens);

/// Describes what a calibration that is possible has against it, one sentence each: a principal
/// point far from the middle, a very narrow view, an output that stretches the image, a crop that
/// leaves little of it.
/// @param camera the rectified one
[[nodiscard]] std::vector<std::string> doubtsAbout(const Lens& lens,
                                                   RectificationMode mode,
                                                   const PinholeCamera& camera);

}  // namespace dsorb
