// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/calibration.h"
#include "dsorb/options/window.h"

#include "window/window.h"

#include <cstddef>

namespace dsorb::window {

/// What an adjusted window asks of a camera that it does not estimate: one linear step of focal
/// lengths, principal point and radial distortion beside the rest. The marginal prior, which was
/// made with the calibrated camera, does not count, nor does what else is known of depths. The
/// window's estimates stay.
/// @param noise           of a pixel's residual [grey levels]
/// @param chunks_per_task of 128 points; 0 runs serially
[[nodiscard]] CameraScore scoreCamera(Window& window,
                                      const WindowOptions& options,
                                      double noise,
                                      std::size_t chunks_per_task);

}  // namespace dsorb::window
