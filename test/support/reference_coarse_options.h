// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/options/coarse.h"

namespace dsorb {

/// The published system: its behaviour and its numbers.
inline CoarseOptions referenceCoarseOptions() {
  CoarseOptions o;
  o.published = true;
  o.settle_frames = 5;
  o.wanted_parallax_deg = o.min_rival_margin = 0;
  o.max_points = 0;
  o.max_passes = 1;
  o.max_parent_distance = o.min_parallax_deg = o.min_motion_gain = 0;
  o.max_outlier_share = 1;
  o.max_frames = 0;
  return o;
}

}  // namespace dsorb
