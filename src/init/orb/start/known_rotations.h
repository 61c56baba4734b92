// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/options/orb_mapping.h"

#include "init/orb/map/initial_map.h"

#include <cstddef>
#include <optional>
#include <vector>

namespace dsorb::init_orb {

/// Rotations that the caller knows between the reference and some frames after it, each since the
/// one before it in the list.
/// @param all    frames, the reference first
/// @param frames ascending indices; the reference may be among them
std::vector<KnownRotation> knownRotations(const std::vector<FramePtr>& all,
                                          const std::vector<std::size_t>& frames);

/// Adjusts a map once more with the rotations, unless they contradict the images: the corners then
/// fit worse than errors of the rotations as claimed let expect. The map stays as it was then.
/// @param map adjusted without them
/// @return    whether they take part from now on; nothing where there are none
std::optional<bool> adjustWithRotations(InitialMap& map,
                                        std::vector<KnownRotation> rotations,
                                        const PinholeCamera& camera,
                                        const GeometricOptions& options);

}  // namespace dsorb::init_orb
