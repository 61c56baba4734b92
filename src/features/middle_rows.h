// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/frame.h"

#include "features/corner_tracks.h"

#include <vector>

namespace dsorb {

/// Tracks as a global shutter would have given them: every position is moved along its own track,
/// a parabola through the three nearest frames that saw it (a line through two), to the time of the
/// frame's middle row. Neither a pose nor a depth is needed.
/// @param frames one a frame of the tracks, with row times
/// @param readout_change over the calibrated readout [s]
CornerTracks atMiddleRows(CornerTracks tracks,
                          const std::vector<FramePtr>& frames,
                          double readout_change = 0);

}  // namespace dsorb
