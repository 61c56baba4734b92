// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/geometry/se3.h"
#include "dsorb/image/affine_brightness.h"
#include "dsorb/image/frame.h"
#include "dsorb/options/depth.h"
#include "dsorb/options/window.h"

#include "image/photometric.h"
#include "window/window.h"

#include <cstddef>
#include <vector>

namespace dsorb::window {

/// A tracked frame with its pose and brightness.
struct TrackedFrame {
  FramePtr frame;
  SE3 T_cam_world;
  AffineBrightness affine;
  RowMotion motion{};  ///< while its rows are read
};

/// Searches all candidates of all keyframes in a tracked frame.
void refineCandidates(Window& window, const TrackedFrame& tracked, const DepthOptions& options);

/// Turns candidates of the older keyframes into points where the newest keyframe has room for them,
/// each with a residual to every keyframe that sees it.
/// @source Engel et al., DSO, arXiv:1607.02565, section 3.2
void activateCandidates(Window& window,
                        const WindowOptions& window_options,
                        const DepthOptions& options);

/// Searches pixels of the first keyframe in other frames and turns what is found into points.
void fillUp(Window& window,
            const std::vector<SelectedPixel>& pixels,
            const std::vector<TrackedFrame>& frames,
            const WindowOptions& window_options,
            const DepthOptions& options);

/// Inverse depths of the newest keyframe's pixels by the points it sees, for the tracker; weight
/// sqrt(1e-3 / (1 / information + 1e-12)). Call after an adjustment, before points retire.
/// @source weight: DSO as published
[[nodiscard]] std::vector<DepthSample> depthSamples(const Window& window,
                                                    const WindowOptions& options);

/// Tells the candidates of a keyframe what inverse depths the points around them let expect.
/// @param samples of the keyframe
void expectDepths(Keyframe& keyframe, const std::vector<DepthSample>& samples);

}  // namespace dsorb::window
