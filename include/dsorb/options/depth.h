// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/options/field.h"

namespace dsorb {

/// Candidate points: pixels of keyframes that wait for a depth.
struct DepthOptions {
  int candidates_per_keyframe = 1000;  ///< number that the selection aims at
  /// Searched again is an interval that is at least this many times the expected error long: what
  /// a search leaves is twice the error, so that it becomes half as long. Reference: 2
  double min_improvement = 4;
  /// Faults of the published system included: the error model ignores camera roll, a candidate that
  /// left one frame is never searched again, its first energy has no outlier limit. Reference: true
  bool published = false;
};

/// Field list; see DescribeFor.
template <typename Visitor, typename Options>
DescribeFor<Options, DepthOptions> describe(Visitor& visit, Options& o) {
  visit.field("candidates_per_keyframe", o.candidates_per_keyframe, Range{10, 100000}, "points");
  visit.field("min_improvement", o.min_improvement, Range{0, 1000}, "expected errors");
  visit.field("published", o.published);
}

}  // namespace dsorb
