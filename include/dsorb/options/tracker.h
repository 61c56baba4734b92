// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/options/field.h"

namespace dsorb {

/// Options of the direct tracker (coarse-to-fine pose and brightness of one frame).
struct TrackerOptions {
  /// Of the reference points in the image; below: lost. True poses were tracked to 0.2 deg and
  /// 0.005 units on TartanAir hospital down to 0.33.
  double min_inside_fraction = 0.3;
  /// Level 0; above: lost [grey levels]. Measured against the initial map alone. KITTI 00 after
  /// ORBInitializer, 5 starts: up to 13.9 path errors stay at 2 to 4 % where they began so, at 13.9
  /// a first pose is wrong by 2 deg; 12, 13, 14 track 5, 10, 16 frames in the median. Synthetic
  /// street with true depths: 7 % at 13, 20 % at 14. TartanAir hospital: a first wrong pose
  /// at 13.0.
  double max_rmse = 13.5;
  /// Change of the log gain between two frames; above, the hypothesis is refused. Wrong poses lower
  /// their residual by lowering contrast: without this bound, on TartanAir hospital, the gain fell
  /// by 0.4 to 0.7 in the frame where tracking failed and rotation errors up to 23 deg went
  /// unnoticed.
  double max_gain_step = 0.3;
};

template <typename Visitor, typename Options>
DescribeFor<Options, TrackerOptions> describe(Visitor& visit, Options& o) {
  visit.field("min_inside_fraction", o.min_inside_fraction, Range{0, 1}, "");
  visit.field("max_gain_step", o.max_gain_step, Range{0, 100}, "");
  visit.field("max_rmse", o.max_rmse, Range{0.1, 1000}, "grey levels");
}

}  // namespace dsorb
