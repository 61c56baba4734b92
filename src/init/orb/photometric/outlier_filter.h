// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/init/report.h"
#include "dsorb/options/orb_mapping.h"

#include "init/orb/map/initial_map.h"

namespace dsorb::init_orb {

struct PhotometricProblem;

/// Removes corners and semi-dense points that do not fit after a photometric adjustment.
/// Pixel votes: a pixel is out when its residual is `t_quantile` scales of its frame's
/// t-distribution, an observation when more than half of its pixels are, a point when fewer than
/// `min_observations` remain (or all frames, when there are fewer). Combined: a point goes when its
/// predicted sigma is large, its neighbours disagree, or its residuals, divided by what their
/// gradients let expect, have a small mean weight under the t-distribution.
/// @source the report on feature-based initialization, section 3.4; experiments on rendered and
///         real sequences, section A5
/// @param problem the map's; what is removed there goes here, too
OutlierReport removeOutliers(InitialMap& map,
                             PhotometricProblem& problem,
                             const PhotometricOptions& photometric,
                             OutlierRule rule);

}  // namespace dsorb::init_orb
