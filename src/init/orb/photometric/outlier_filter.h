// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/init/report.h"
#include "dsorb/options/orb_mapping.h"

#include "init/orb/map/initial_map.h"

namespace dsorb::init_orb {

struct PhotometricProblem;

/// Removes corners and semi-dense points that do not fit after a photometric adjustment.
/// Pixel votes: a pixel is an outlier when its residual exceeds a quantile of its frame's
/// t-distribution, an observation when more than half of its pixels are, and a point when fewer
/// than two observations remain (or fewer than there are frames). Combined: a point is removed
/// when its predicted sigma is large, when its neighbours disagree, or when its residuals, divided
/// by the noise expected at their gradients, have a small mean weight under the t-distribution.
/// @source pixel votes: [Gladkova], section 3.4; combined: docs/experiments.md, "Outlier filter"
/// @param problem of the map; its patches of removed points are removed as well
OutlierReport removeOutliers(InitialMap& map, PhotometricProblem& problem, OutlierRule rule);

}  // namespace dsorb::init_orb
