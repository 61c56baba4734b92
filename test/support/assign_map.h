// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "init/orb/bundle/geometric_covariance.h"
#include "init/orb/bundle/robust_adjustment.h"
#include "init/orb/map/initial_map.h"

#include <cmath>
#include <optional>
#include <utility>

namespace dsorb::init_orb {

/// Puts an adjusted map in the place of another one. @return whether there is one
inline bool assign(std::optional<InitialMap> adjusted, InitialMap& map) {
  if (adjusted) map = std::move(*adjusted);
  return adjusted.has_value();
}

/// Adjusts a map without outliers in its own place, makes its mean inverse depth 1 and sets its
/// covariances. @return the variance factor [-], nothing where the map is not usable
inline std::optional<double> adjust(InitialMap& map,
                                    const PinholeCamera& camera,
                                    const GeometricOptions& options) {
  if (!assign(adjustOnce(map, camera, options), map) || !normalizeCornerScale(map)) return {};
  const double factor = setCovariances(map, camera, options);
  return std::isfinite(factor) ? std::optional(factor) : std::nullopt;
}

}  // namespace dsorb::init_orb
