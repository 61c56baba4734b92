// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "init/orb/map/initial_map.h"
#include "init/orb/thesis/geometric_adjustment.h"

#include <optional>
#include <utility>

namespace dsorb::init_orb {

/// Puts an adjusted map in the place of another one. @return whether there is one
inline bool assign(std::optional<InitialMap> adjusted, InitialMap& map) {
  if (adjusted) map = std::move(*adjusted);
  return adjusted.has_value();
}

/// Puts the map of a geometric adjustment in the place of another one. @return its report
inline GeometricReport assign(GeometricAdjustment adjusted, InitialMap& map) {
  map = std::move(adjusted.map);
  return adjusted.report;
}

}  // namespace dsorb::init_orb
