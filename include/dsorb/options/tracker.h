// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/options/field.h"

namespace dsorb {

/// Options of the direct tracker (coarse-to-fine pose and brightness of one frame): when a frame
/// counts as lost. What the limits were measured on is in track/tracker.cpp.
struct TrackerOptions {
  double min_inside_fraction = 0.3;  ///< of the reference points in the image; below: lost
  /// Largest step of the log gain between two frames; a larger one is refused unless the
  /// distribution of the grey levels shows it, up to this share.
  double max_gain_step = 0.3;
  double max_rmse = 13.5;  ///< level 0; above: lost [grey levels]
};

/// Field list; see DescribeFor.
template <typename Visitor, typename Options>
DescribeFor<Options, TrackerOptions> describe(Visitor& visit, Options& o) {
  visit.field("min_inside_fraction", o.min_inside_fraction, Range{0, 1}, "");
  visit.field("max_gain_step", o.max_gain_step, Range{0, 100}, "");
  visit.field("max_rmse", o.max_rmse, Range{0.1, 1000}, "grey levels");
}

}  // namespace dsorb
