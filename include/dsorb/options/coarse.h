// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/options/field.h"

namespace dsorb {

/// Options of CoarseInitializer: direct alignment of pose and inverse depths of a first and a
/// newest frame.
/// @source the initializer of DSO as published with Engel et al., arXiv:1607.02565 (the paper does
///         not describe it)
struct CoarseOptions {
  bool published = false;            ///< faults included: docs/variants.md, "The published coarse"
  int settle_frames = 2;             ///< frames after the one that left the prior, at least
  double wanted_parallax_deg = 1.5;  ///< median; 0: not waited for
  int max_points = 6000;             ///< of a level; 0: as the density says
  int max_passes = 4;                ///< over all levels, for a frame that does not match at once
  double min_rival_margin = 0.15;    ///< energy of the best motion elsewhere, less 1; 0: no rivals
  double max_parent_distance = 2;    ///< pixels of the coarser level; 0: no limit
  double min_parallax_deg = 0.7;     ///< of the result, median; 0: no test
  double min_motion_gain = 0.4;      ///< share of the residual energy that translation removes
  double max_outlier_share = 0.65;   ///< of the points in view, more: tracking is lost; 1: no test
  int max_frames = 40;               ///< since the reference; 0: wait for ever
};

/// Field list; see DescribeFor.
template <typename Visitor, typename Options>
DescribeFor<Options, CoarseOptions> describe(Visitor& visit, Options& o) {
  visit.field("published", o.published);
  visit.field("settle_frames", o.settle_frames, Range{0, 100}, "frames");
  visit.field("wanted_parallax_deg", o.wanted_parallax_deg, Range{0, 45}, "deg");
  visit.field("max_points", o.max_points, Range{0, 1000000}, "points");
  visit.field("max_passes", o.max_passes, Range{1, 100}, "passes");
  visit.field("min_rival_margin", o.min_rival_margin, Range{0, 10}, "");
  visit.field("max_parent_distance", o.max_parent_distance, Range{0, 1000}, "px of the level");
  visit.field("min_parallax_deg", o.min_parallax_deg, Range{0, 45}, "deg");
  visit.field("min_motion_gain", o.min_motion_gain, Range{0, 1}, "");
  visit.field("max_outlier_share", o.max_outlier_share, Range{0, 1}, "");
  visit.field("max_frames", o.max_frames, Range{0, 1000}, "frames");
}

}  // namespace dsorb
