// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/options/field.h"

namespace dsorb {

/// Iteration of the windowed adjustment.
struct OptimizerOptions {
  /// An adjustment ends with a step that corrects camera and frames by less than the root of this
  /// many standard deviations in the mean: by a third of one. 0 (reference): never
  double min_decrease = 0.1;
  bool optimize_intrinsics = false;  ///< reference: true
};

/// Field list; see DescribeFor.
template <typename Visitor, typename Options>
DescribeFor<Options, OptimizerOptions> describe(Visitor& visit, Options& o) {
  visit.field("min_decrease", o.min_decrease, Range{0, 1000}, "squared standard deviations");
  visit.field("optimize_intrinsics", o.optimize_intrinsics);
}

/// Weights of the priors; those of intrinsics in scaled units (window/window.h). Where a focal
/// length is known to less than .15, the rest of its camera is held in proportion.
struct PriorOptions {
  double intrinsics = 1e5;  ///< reference: 5e9
  double focal_sigma = 0;   ///< relative, of a guess; above 0 instead of the former. `--hfov`: 0.15
  double depth_gain = 8;    ///< on 1 / variance of an initial point: kImageNoise^2
  double max_depth = 2500;  ///< upper limit of an initial point's prior
  double depth_at_marginalization = 360000;  ///< factor on the depth prior, 600^2
};

/// Field list; see DescribeFor.
template <typename Visitor, typename Options>
DescribeFor<Options, PriorOptions> describe(Visitor& visit, Options& o) {
  visit.field("intrinsics", o.intrinsics, Range{0, 1e16}, "");
  visit.field("focal_sigma", o.focal_sigma, Range{0, 1}, "");
  visit.field("depth_gain", o.depth_gain, Range{0, 1e9}, "grey levels^2");
  visit.field("max_depth", o.max_depth, Range{0, 1e12}, "grey levels^2 unit^2");
  visit.field("depth_at_marginalization", o.depth_at_marginalization, Range{1, 1e9}, "");
}

/// The window of keyframes and its adjustment.
struct WindowOptions {
  int min_keyframes = 5;          ///< below which none is retired for its points or its brightness
  int max_keyframes = 7;          ///< after marginalisation; one more while optimising
  int first_keyframes = 4;        ///< at most, of the frames that an initialization has posed
  double keyframe_frequency = 1;  ///< factor on flow and change of brightness that want one
  int desired_points = 2000;      ///< in the adjustment, of all keyframes together
  /// Faults of the published system included: every step is kept at constant damping, outlier
  /// limits change with every evaluation, the depth prior only damps, a marginalised prior's
  /// gradient is taken at the current state, tracking depths use first-estimate poses. Reference:
  /// true
  bool published = false;
  OptimizerOptions optimizer;  ///< its iteration
  PriorOptions prior;          ///< its priors
};

/// Field list; see DescribeFor.
template <typename Visitor, typename Options>
DescribeFor<Options, WindowOptions> describe(Visitor& visit, Options& o) {
  visit.field("min_keyframes", o.min_keyframes, Range{2, 10}, "keyframes");
  visit.field("max_keyframes", o.max_keyframes, Range{2, 10}, "keyframes");
  visit.field("first_keyframes", o.first_keyframes, Range{2, 10}, "keyframes");
  visit.field("keyframe_frequency", o.keyframe_frequency, Range{0, 100}, "");
  visit.field("desired_points", o.desired_points, Range{10, 100000}, "points");
  visit.field("published", o.published);
  visit.group("optimizer", o.optimizer);
  visit.group("prior", o.prior);
}

}  // namespace dsorb
