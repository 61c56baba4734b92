// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/options/window.h"

#include "image/photometric.h"
#include "window/window.h"

#include <vector>

namespace dsorb::window {

/// Inverse depths of the newest keyframe's pixels by the points it sees, for the tracker; weight
/// sqrt(1e-3 / (1 / information + 1e-12)). Call after an adjustment, before points retire.
/// @source weight: DSO as published
[[nodiscard]] std::vector<DepthSample> depthSamples(const Window& window,
                                                    const WindowOptions& options);

/// Tells the candidates of a keyframe what inverse depths the points around them let expect.
/// @param samples of the keyframe
void expectDepths(Keyframe& keyframe, const std::vector<DepthSample>& samples);

}  // namespace dsorb::window
