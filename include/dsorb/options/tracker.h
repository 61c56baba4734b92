// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/options/field.h"

namespace dsorb {

/// Options of the direct tracker (coarse-to-fine pose and brightness of one frame).
struct TrackerOptions {
  double huber_threshold = 9;  ///< [grey levels]
};

template <typename Visitor, typename Options>
DescribeFor<Options, TrackerOptions> describe(Visitor& visit, Options& o) {
  visit.field("huber_threshold", o.huber_threshold, Range{0.1, 255}, "grey levels");
}

}  // namespace dsorb
