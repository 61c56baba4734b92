// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/options/field.h"

namespace dsorb {

/// Options of ORB features that are matched by their descriptors.
struct OrbMatchingOptions {
  int max_features = 2000;
  int cell_size = 64;         ///< of the grid that spreads the features [px]
  int levels = 8;             ///< of the image pyramid
  double scale_factor = 1.2;  ///< between two levels
  int fast_threshold = 7;     ///< contrast of a FAST corner to its ring [grey levels]
  double max_ratio = 0.8;     ///< of the best distance to the second best
  int max_distance = 64;      ///< between two descriptors [bits of 256]
  int min_matches = 100;      ///< fewer: optical flow
  bool refine = true;         ///< matched positions by Lucas-Kanade: to a fraction of a pixel
  double max_refinement = 4;  ///< a match that moves farther goes [px]
};

template <typename Visitor, typename Options>
DescribeFor<Options, OrbMatchingOptions> describe(Visitor& visit, Options& o) {
  visit.field("max_features", o.max_features, Range{50, 20000}, "features");
  visit.field("cell_size", o.cell_size, Range{8, 4096}, "px");
  visit.field("levels", o.levels, Range{1, 16}, "levels");
  visit.field("scale_factor", o.scale_factor, Range{1.01, 2}, "");
  visit.field("fast_threshold", o.fast_threshold, Range{1, 255}, "grey levels");
  visit.field("max_ratio", o.max_ratio, Range{0.01, 1}, "");
  visit.field("max_distance", o.max_distance, Range{0, 256}, "bits");
  visit.field("min_matches", o.min_matches, Range{8, 20000}, "matches");
  visit.field("refine", o.refine);
  visit.field("max_refinement", o.max_refinement, Range{0, 100}, "px");
}

}  // namespace dsorb
