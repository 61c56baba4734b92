// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/calibration.h"
#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/options/orb_mapping.h"

#include "init/orb/map/initial_map.h"

#include <optional>

namespace dsorb::init_orb {

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
