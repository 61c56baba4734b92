// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/error.h"
#include "dsorb/init/initializer.h"

#include "base/describe.h"
#include "init/coarse/coarse_initializer.h"
#include "init/orb/orb_initializer.h"
#include "init/orb/thesis/with_ceres.h"
#include "init/registry.h"

#include <stdexcept>
#include <string>

namespace dsorb {
namespace {

/// @throws ConfigError where the options ask for what a build without Ceres lacks
void refuseWithoutCeres(const OrbOptions& orb) {
  const char* value = nullptr;
  if (orb.front_end == OrbFrontEnd::kDescriptors) value = "orb.front_end = descriptors";
  if (orb.tracks.flow == OpticalFlow::kOpenCv) value = "orb.tracks.flow = opencv";
  if (orb.geometric.solver == AdjustmentSolver::kCeres) value = "orb.geometric.solver = ceres";
  if (orb.photometric.solver == AdjustmentSolver::kCeres) value = "orb.photometric.solver = ceres";
  if (value != nullptr) {
    throw ConfigError(std::string("option ") + value +
                      " needs a build with Ceres (DSORB_WITH_CERES=ON)");
  }
}

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
      if (!init_orb::builtWithCeres()) refuseWithoutCeres(options.orb);
      return std::make_unique<init_orb::ORBInitializer>(options, camera);
    case InitializerKind::kCoarse:
      return std::make_unique<init_coarse::CoarseInitializer>(options, camera);
    case InitializerKind::kRegistered:
      return makeRegistered(options, camera);
  }
  throw ConfigError("initializer of unknown kind");
}

}  // namespace dsorb
