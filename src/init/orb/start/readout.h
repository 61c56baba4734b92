// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/calibration.h"
#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/image/frame.h"
#include "dsorb/options/orb_mapping.h"

#include "features/corner_tracks.h"
#include "init/orb/map/attempt_types.h"
#include "init/orb/map/initial_map.h"

#include <optional>
#include <vector>

namespace dsorb::init_orb {

/// Tracks as a global shutter would have given them: every position is moved along its own track,
/// a parabola through the three nearest frames that saw it (a line through two), to the time of the
/// frame's middle row. Neither a pose nor a depth is needed.
/// @param frames one a frame of the tracks, with row times
/// @param readout_change over the calibrated readout [s]
CornerTracks atMiddleRows(CornerTracks tracks,
                          const std::vector<FramePtr>& frames,
                          double readout_change = 0);

/// The tracks as a global shutter would have given them, where the frames' rows have times of their
/// own.
ReferenceView withGlobalShutter(ReferenceView seen, const Readout& readout);

/// Readout that explains the tracks best: profile of the negative logarithm of its posterior, with
/// motion and corners adjusted at each of a few readouts, and its parabola around the least one.
/// @param seen tracks as the images show them, of a camera whose readout has a sigma
/// @return the calibrated readout where the tracks do not clearly ask for another
Readout profileReadout(const ReferenceView& seen, const AttemptContext& context);

/// What an adjusted map of a global shutter says of the readout of its camera: one Gauss-Newton
/// step by the readout, poses and inverse depths together from a readout of 0, rows read in the
/// order of the image's. The velocity of a frame is that of the parabola through the frames around
/// it. Sigma is a-posteriori, with the clustered covariance of setCovariances().
/// @param options as for setCovariances(), which has been called
/// @return nullopt where the map does not tell
std::optional<Readout> scoreReadout(const InitialMap& map,
                                    const PinholeCamera& camera,
                                    const GeometricOptions& options);

}  // namespace dsorb::init_orb
