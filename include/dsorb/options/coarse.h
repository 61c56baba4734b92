// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/options/field.h"

namespace dsorb {

/// Options of CoarseInitializer: direct alignment of pose and inverse depths of a first and a
/// newest frame. Every fault of the published system that is mended has a switch of its own;
/// `referenceCoarseOptions()` has them all off.
/// @source the initializer of DSO as published with Engel et al., arXiv:1607.02565 (the paper does
///         not describe it)
struct CoarseOptions {
  int settle_frames = 2;             ///< frames after the one that left the prior, at least
  int max_settle_frames = 5;         ///< to wait for the wanted parallax; as published
  double wanted_parallax_deg = 1.5;  ///< median; 0: not waited for
  int handover_points = 2000;        ///< points of the result, at most
  int max_points = 6000;             ///< of a level; 0: as the density says
  int max_passes = 4;                ///< over all levels, for a frame that does not match at once

  bool consistent_energy = true;    ///< count in the energy what the equations minimise
  bool release_prior = true;        ///< once left, the prior stays off
  bool estimate_brightness = true;  ///< gain and offset with the pose
  bool balance_gain = true;         ///< lower contrast does not pay where the images do not match
  bool predict_motion = true;       ///< start each frame from the last relative motion
  bool search_rotation = true;      ///< a grid of start rotations where images do not match
  double min_snap_gain = 0.2;  ///< share of the residual energy that translation removes, less: the
                               ///< prior comes back; 0: no test
  bool try_hypotheses = true;  ///< other motions as starts when the prior goes
  double min_rival_margin = 0.15;  ///< by which the best motion elsewhere explains the images worse
                                   ///< before it starts, share of the energy; 0: no rivals
  bool drop_bad_points = true;     ///< hand over only points seen well in the newest frame
  bool spread_points = true;       ///< hand over the best constrained point of each grid cell
  bool keep_orphan_depth = true;   ///< a coarse point without fine points keeps its depth
  double max_parent_distance = 2;  ///< pixels of the coarser level; 0: no limit
  double min_parallax_deg = 0.7;   ///< of the result, median; 0: no test
  double min_motion_gain = 0.4;    ///< share of the residual energy that translation removes
  double max_outlier_share = 0.65;   ///< of the points in view, more: tracking is lost; 1: no test
  double max_relative_sigma = 0.35;  ///< median of the result's inverse depths; 0: no test
  int max_frames = 40;               ///< since the reference; 0: wait for ever
  double effective_points = 2.5;     ///< whose information the pose's variance is worth; 0: formal
};

/// The published behaviour, its faults included.
inline CoarseOptions referenceCoarseOptions() {
  CoarseOptions o;
  o.settle_frames = 5;
  o.consistent_energy = o.release_prior = o.estimate_brightness = o.predict_motion = false;
  o.balance_gain = false;
  o.search_rotation = o.try_hypotheses = false;
  o.wanted_parallax_deg = o.min_snap_gain = o.min_rival_margin = 0;
  o.max_points = 0;
  o.max_passes = 1;
  o.drop_bad_points = o.spread_points = o.keep_orphan_depth = false;
  o.max_parent_distance = o.min_parallax_deg = o.min_motion_gain = o.max_relative_sigma = 0;
  o.max_outlier_share = 1;
  o.max_frames = 0;
  return o;
}

template <typename Visitor, typename Options>
DescribeFor<Options, CoarseOptions> describe(Visitor& visit, Options& o) {
  visit.field("settle_frames", o.settle_frames, Range{0, 100}, "frames");
  visit.field("max_settle_frames", o.max_settle_frames, Range{0, 100}, "frames");
  visit.field("wanted_parallax_deg", o.wanted_parallax_deg, Range{0, 45}, "deg");
  visit.field("handover_points", o.handover_points, Range{50, 100000}, "points");
  visit.field("max_points", o.max_points, Range{0, 1000000}, "points");
  visit.field("max_passes", o.max_passes, Range{1, 100}, "passes");
  visit.field("consistent_energy", o.consistent_energy);
  visit.field("release_prior", o.release_prior);
  visit.field("estimate_brightness", o.estimate_brightness);
  visit.field("balance_gain", o.balance_gain);
  visit.field("predict_motion", o.predict_motion);
  visit.field("search_rotation", o.search_rotation);
  visit.field("try_hypotheses", o.try_hypotheses);
  visit.field("min_snap_gain", o.min_snap_gain, Range{0, 1}, "");
  visit.field("min_rival_margin", o.min_rival_margin, Range{0, 10}, "");
  visit.field("drop_bad_points", o.drop_bad_points);
  visit.field("spread_points", o.spread_points);
  visit.field("keep_orphan_depth", o.keep_orphan_depth);
  visit.field("max_parent_distance", o.max_parent_distance, Range{0, 1000}, "px of the level");
  visit.field("min_parallax_deg", o.min_parallax_deg, Range{0, 45}, "deg");
  visit.field("min_motion_gain", o.min_motion_gain, Range{0, 1}, "");
  visit.field("max_outlier_share", o.max_outlier_share, Range{0, 1}, "");
  visit.field("max_relative_sigma", o.max_relative_sigma, Range{0, 100}, "");
  visit.field("max_frames", o.max_frames, Range{0, 1000}, "frames");
  visit.field("effective_points", o.effective_points, Range{0, 100000}, "points");
}

}  // namespace dsorb
