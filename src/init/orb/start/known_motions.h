// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/options/orb_mapping.h"

#include "init/orb/map/initial_map.h"

#include <cstddef>
#include <optional>
#include <vector>

namespace dsorb::init_orb {

/// Motions that the caller knows between the reference and some frames after it, each since the
/// nearest of them on its chain of priors.
/// @param all    frames, the reference first
/// @param frames ascending indices; the reference counts as one of them
std::vector<KnownMotion> knownMotions(const std::vector<FramePtr>& all,
                                      const std::vector<std::size_t>& frames);

/// A map after adjustWithMotions().
struct MotionAdjustment {
  InitialMap map;
  std::optional<bool> used{};  ///< whether the motions take part from now on; none: there are none
};

/// Adjusts a map once more with the motions, unless they contradict the images: the corners then
/// fit worse than errors of the motions as claimed let expect. The map stays as it was then.
/// @param map adjusted without them
MotionAdjustment adjustWithMotions(InitialMap map,
                                   const std::vector<KnownMotion>& motions,
                                   const PinholeCamera& camera,
                                   const GeometricOptions& options);

}  // namespace dsorb::init_orb
