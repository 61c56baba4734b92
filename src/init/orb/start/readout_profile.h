// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/calibration.h"

#include "init/orb/map/attempt_types.h"

namespace dsorb::init_orb {

/// The tracks as a global shutter would have given them, where the frames' rows have times of their
/// own.
ReferenceView withGlobalShutter(ReferenceView seen, const Readout& readout);

/// Readout that explains the tracks best: profile of the negative logarithm of its posterior, with
/// motion and corners adjusted at each of a few readouts, and its parabola around the least one.
/// @param seen tracks as the images show them, of a camera whose readout has a sigma
/// @return the calibrated readout where the tracks do not clearly ask for another
Readout profileReadout(const ReferenceView& seen, const AttemptContext& context);

}  // namespace dsorb::init_orb
