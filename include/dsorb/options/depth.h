// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/options/field.h"

namespace dsorb {

/// Epipolar search of a candidate point in a posed frame. Defaults as published unless noted.
struct EpipolarOptions {
  bool rotate_gradients = true;  ///< false (reference): error model ignores camera roll
  bool final_out_of_bounds =
      false;  ///< true (reference): a candidate that left one frame is never searched again
};

template <typename Visitor, typename Options>
DescribeFor<Options, EpipolarOptions> describe(Visitor& visit, Options& o) {
  visit.field("rotate_gradients", o.rotate_gradients);
  visit.field("final_out_of_bounds", o.final_out_of_bounds);
}

/// Which candidates become points of the window.
struct ActivationOptions {
  bool consistent_energy = true;  ///< false (reference): first energy without outlier limit
};

template <typename Visitor, typename Options>
DescribeFor<Options, ActivationOptions> describe(Visitor& visit, Options& o) {
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
