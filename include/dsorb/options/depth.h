// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/options/field.h"

namespace dsorb {

/// Epipolar search of a candidate point in a posed frame. Defaults as published unless noted.
struct EpipolarOptions {
  double max_search_share = 0.027;  ///< longest search, relative to width + height
  double min_interval = 1.5;        ///< shorter epipolar intervals are not searched again
  double min_improvement = 2;       ///< interval must be this many times the expected error
  double max_error = 10;            ///< expected error is limited to this
  double min_depth_ratio = 0.75;    ///< admissible depth in the frame over depth in the host
  double max_depth_ratio = 1.5;
  int refinement_iterations = 3;  ///< Gauss-Newton along the line
  double outlier_slack = 1.2;     ///< on the patch energy that makes a match an outlier
  bool rotate_gradients = true;   ///< false (reference): error model ignores camera roll
  bool final_out_of_bounds =
      false;  ///< true (reference): a candidate that left one frame is never searched again
};

template <typename Visitor, typename Options>
DescribeFor<Options, EpipolarOptions> describe(Visitor& visit, Options& o) {
  visit.field("max_search_share", o.max_search_share, Range{1e-3, 1}, "");
  visit.field("min_interval", o.min_interval, Range{0.1, 100}, "px");
  visit.field("min_improvement", o.min_improvement, Range{0, 100}, "");
  visit.field("max_error", o.max_error, Range{0.1, 100}, "px");
  visit.field("min_depth_ratio", o.min_depth_ratio, Range{0, 1}, "");
  visit.field("max_depth_ratio", o.max_depth_ratio, Range{1, 100}, "");
  visit.field("refinement_iterations", o.refinement_iterations, Range{0, 100}, "iterations");
  visit.field("outlier_slack", o.outlier_slack, Range{0.1, 100}, "");
  visit.field("rotate_gradients", o.rotate_gradients);
  visit.field("final_out_of_bounds", o.final_out_of_bounds);
}

/// Which candidates become points of the window.
struct ActivationOptions {
  double min_quality = 3;         ///< second best over best energy of the last long search
  double max_interval = 8;        ///< uncertainty along the epipolar line
  double initial_distance = 2;    ///< to the nearest point, half resolution; adapted
  double max_distance = 4;        ///< upper limit of the adapted distance
  int iterations = 3;             ///< of the depth alone, before activation
  double min_information = 100;   ///< curvature of the energy a depth needs [grey^2 unit^2]
  int min_observations = 1;       ///< good residuals a depth needs
  bool consistent_energy = true;  ///< false (reference): first energy without outlier limit
};

template <typename Visitor, typename Options>
DescribeFor<Options, ActivationOptions> describe(Visitor& visit, Options& o) {
  visit.field("min_quality", o.min_quality, Range{0, 1000}, "");
  visit.field("max_interval", o.max_interval, Range{0.1, 100}, "px");
  visit.field("initial_distance", o.initial_distance, Range{0, 40}, "px of half resolution");
  visit.field("max_distance", o.max_distance, Range{0, 40}, "px of half resolution");
  visit.field("iterations", o.iterations, Range{0, 100}, "iterations");
  visit.field("min_information", o.min_information, Range{0, 1e9}, "grey levels^2 unit^2");
  visit.field("min_observations", o.min_observations, Range{1, 10}, "residuals");
  visit.field("consistent_energy", o.consistent_energy);
}

/// Candidate points: pixels of keyframes that wait for a depth.
struct DepthOptions {
  int candidates_per_keyframe = 1500;
  EpipolarOptions epipolar;
  ActivationOptions activation;
};

template <typename Visitor, typename Options>
DescribeFor<Options, DepthOptions> describe(Visitor& visit, Options& o) {
  visit.field("candidates_per_keyframe", o.candidates_per_keyframe, Range{10, 100000}, "points");
  visit.group("epipolar", o.epipolar);
  visit.group("activation", o.activation);
}

}  // namespace dsorb
