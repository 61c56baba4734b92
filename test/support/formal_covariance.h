// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "init/orb/bundle/geometric_covariance.h"

#include <gtest/gtest.h>

#include <cmath>

namespace dsorb::init_orb {

/// Covariances of an adjusted map as of independent errors: what referees compute.
inline void setFormalCovariances(InitialMap& map,
                                 const PinholeCamera& camera,
                                 const GeometricOptions& options) {
  const GeometricMarginals joint(map, camera, options);
  ASSERT_TRUE(joint.variance_factor);
  const double factor = *joint.variance_factor;
  setCovariances(map, joint, std::sqrt(factor) * joint.marginals.roots(), factor);
}

}  // namespace dsorb::init_orb
