// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/options/coarse.h"
#include "dsorb/options/field.h"
#include "dsorb/options/orb.h"
#include "dsorb/options/published.h"
#include "dsorb/options/skip.h"

#include <string>
#include <vector>

namespace dsorb {

/// Which initializer runs.
enum class InitializerKind {
  kCoarse,
  kOrb,
  kRegistered  ///< a kind that a library brought (init/registry.h)
};

/// Options of an initializer; those of other kinds are ignored, but for orb.gate.wrong_angle_deg.
struct InitializerOptions {
  InitializerKind kind = InitializerKind::kOrb;  ///< which one runs
  std::string registered;                        ///< name of the registered kind
  int seed = 1;                                  ///< seed of every random choice
  int num_threads = 1;                           ///< 0: all the machine has
  /// Memory of the frames that wait for a start.
  int max_waiting_mb = 64;
  CoarseOptions coarse;        ///< of kCoarse
  OrbOptions orb;              ///< of kOrb
  PublishedOptions published;  ///< of `orb-v1` to `orb-v3` and `orb-matching`, kRegistered
  Skips skip{};                ///< left out, of the engine as well; for measurements
};

/// Field list; see DescribeFor.
template <typename Visitor, typename Options>
DescribeFor<Options, InitializerOptions> describe(Visitor& visit, Options& o) {
  visit.choice("kind",
               o.kind,
               {{"coarse", InitializerKind::kCoarse},
                {"orb", InitializerKind::kOrb},
                {"registered", InitializerKind::kRegistered}});
  visit.field("seed", o.seed, Range{0, 2147483647}, "");
  visit.field("num_threads", o.num_threads, Range{0, 1024}, "threads");
  visit.field("max_waiting_mb", o.max_waiting_mb, Range{1, 1000000}, "MiB");
  visit.group("coarse", o.coarse);
  visit.group("orb", o.orb);
  visit.group("published", o.published);
}

/// Names of the variants as on the command line: "coarse", "orb", then those of registered kinds.
[[nodiscard]] std::vector<std::string> initializerVariants();

/// Options of a named variant.
/// @throws ConfigError naming the variants there are, or where this one comes from
[[nodiscard]] InitializerOptions initializerVariant(const std::string& name);

}  // namespace dsorb
