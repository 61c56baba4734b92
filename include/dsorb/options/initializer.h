// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/options/field.h"

#include <cstdint>

namespace dsorb {

enum class InitializerKind { kCoarse, kOrb };

/// Options of ORBInitializer, one nested struct a stage.
struct OrbOptions {
  int min_frames = 5;  ///< frames before the first attempt, the reference counted
};

template <typename Visitor, typename Options>
DescribeFor<Options, OrbOptions> describe(Visitor& visit, Options& o) {
  visit.field("min_frames", o.min_frames, Range{2, 100}, "frames");
}

struct InitializerOptions {
  InitializerKind kind = InitializerKind::kOrb;
  int seed = 1;         ///< of every random choice
  int num_threads = 1;  ///< 0: all the machine has
  OrbOptions orb;
};

template <typename Visitor, typename Options>
DescribeFor<Options, InitializerOptions> describe(Visitor& visit, Options& o) {
  visit.choice("kind", o.kind, {{"orb", InitializerKind::kOrb}});
  visit.field("seed", o.seed, Range{0, 2147483647}, "");
  visit.field("num_threads", o.num_threads, Range{0, 1024}, "threads");
  visit.group("orb", o.orb);
}

}  // namespace dsorb
