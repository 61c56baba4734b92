// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/error.h"
#include "dsorb/init/initializer.h"

#include "base/describe.h"
#include "init/coarse/coarse_initializer.h"
#include "init/orb/orb_initializer.h"
#include "init/registry.h"

#include <stdexcept>
#include <string>

namespace dsorb {
namespace {

/// @throws ConfigError where a reference is given up before it may be tried
void refuseImpatience(const OrbOptions& orb) {
  if (orb.min_frames <= orb.max_frames) return;
  throw ConfigError("option orb.min_frames = " + std::to_string(orb.min_frames) +
                    " is more than orb.max_frames = " + std::to_string(orb.max_frames));
}

std::unique_ptr<Initializer> makeRegistered(const InitializerOptions& options,
                                            const PinholeCamera& camera) {
  InitializerOptions own = options;
  own.registered.clear();  // the factory may make one of another kind
  std::unique_ptr<Initializer> made = registeredFactory(options.registered)(own, camera);
  if (!made) throw std::logic_error("the factory of '" + options.registered + "' made nothing");
  return made;
}

}  // namespace

std::unique_ptr<Initializer> makeInitializer(const InitializerOptions& options,
                                             const PinholeCamera& camera) {
  validateOptions(options);
  if (options.kind != InitializerKind::kRegistered && !options.registered.empty()) {
    throw ConfigError("option initializer.registered = '" + options.registered +
                      "': expected the kind registered beside it");
  }
  switch (options.kind) {
    case InitializerKind::kOrb:
      refuseImpatience(options.orb);
      return std::make_unique<init_orb::ORBInitializer>(options, camera);
    case InitializerKind::kCoarse:
      return std::make_unique<init_coarse::CoarseInitializer>(options, camera);
    case InitializerKind::kRegistered:
      return makeRegistered(options, camera);
  }
  throw ConfigError("initializer of unknown kind");
}

}  // namespace dsorb
