// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/options/initializer.h"
#include "dsorb/options/tracker.h"

namespace dsorb {

struct OdometryOptions {
  int num_threads = 1;  ///< 0: all the machine has; replaces initializer.num_threads
  InitializerOptions initializer;
  TrackerOptions tracker;
};

template <typename Visitor, typename Options>
DescribeFor<Options, OdometryOptions> describe(Visitor& visit, Options& o) {
  visit.field("num_threads", o.num_threads, Range{0, 1024}, "threads");
  visit.group("initializer", o.initializer);
  visit.group("tracker", o.tracker);
}

}  // namespace dsorb
