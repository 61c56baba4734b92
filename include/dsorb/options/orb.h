// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/options/field.h"
#include "dsorb/options/orb_mapping.h"

namespace dsorb {

/// Corners of the reference, followed from frame to frame.
struct FeatureTrackOptions {
  int max_corners = 1000;         ///< of a reference
  double corner_quality = 0.003;  ///< corner strength relative to the strongest of the image
  int max_level = 4;              ///< coarsest pyramid level of Lucas-Kanade
  double min_eigenvalue = 0.3;    ///< texture of a patch: smaller one of its mean gradient tensor
};

/// Field list; see DescribeFor.
template <typename Visitor, typename Options>
DescribeFor<Options, FeatureTrackOptions> describe(Visitor& visit, Options& o) {
  visit.field("max_corners", o.max_corners, Range{50, 20000}, "corners");
  visit.field("corner_quality", o.corner_quality, Range{1e-5, 1}, "");
  visit.field("max_level", o.max_level, Range{0, 8}, "levels");
  visit.field("min_eigenvalue", o.min_eigenvalue, Range{0, 1e4}, "grey levels^2 / px^2");
}

/// When a start is sure enough.
struct GateOptions {
  double max_wrong_probability = 0.01;  ///< that the direction of translation is off by more than
  double wrong_angle_deg = 10;          ///< this angle
  double max_depth_sigma = 0.04;        ///< median error of depths, as the scene needs them
};

/// Field list; see DescribeFor.
template <typename Visitor, typename Options>
DescribeFor<Options, GateOptions> describe(Visitor& visit, Options& o) {
  visit.field("max_wrong_probability", o.max_wrong_probability, Range{0, 1}, "");
  visit.field("wrong_angle_deg", o.wrong_angle_deg, Range{0.01, 90}, "deg");
  visit.field("max_depth_sigma", o.max_depth_sigma, Range{0, 10}, "");
}

/// Options of ORBInitializer, one nested struct a stage.
struct OrbOptions {
  /// Before the first attempt, including the reference. Between two frames depths take up whatever
  /// errors run along the epipolar lines; the third contradicts them.
  int min_frames = 3;
  int max_frames = 36;         ///< after which a reference is given up
  int min_tracked = 25;        ///< live tracks below which a reference is given up
  int reference_interval = 5;  ///< frames from one reference to the next; 0: only one at a time
  FeatureTrackOptions tracks;  ///< corners and how they are followed
  GateOptions gate;            ///< when a start is sure enough
  GeometricOptions geometric;  ///< adjustment of the corners
};

/// Field list; see DescribeFor.
template <typename Visitor, typename Options>
DescribeFor<Options, OrbOptions> describe(Visitor& visit, Options& o) {
  visit.field("min_frames", o.min_frames, Range{2, 100}, "frames");
  visit.field("max_frames", o.max_frames, Range{2, 1000}, "frames");
  visit.field("min_tracked", o.min_tracked, Range{8, 20000}, "corners");
  visit.field("reference_interval", o.reference_interval, Range{0, 1000}, "frames");
  visit.group("tracks", o.tracks);
  visit.group("gate", o.gate);
  visit.group("geometric", o.geometric);
}

}  // namespace dsorb
