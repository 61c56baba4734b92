// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/error.h"
#include "dsorb/init/initializer.h"

#include "base/describe.h"
#include "init/coarse/coarse_initializer.h"
#include "init/orb/orb_initializer.h"

namespace dsorb {

std::unique_ptr<Initializer> makeInitializer(const InitializerOptions& options,
                                             const PinholeCamera& camera) {
  validateOptions(options);
  switch (options.kind) {
    case InitializerKind::kOrb:
      return std::make_unique<init_orb::ORBInitializer>(options, camera);
    case InitializerKind::kCoarse:
      return std::make_unique<init_coarse::CoarseInitializer>(options, camera);
  }
  throw ConfigError("initializer of unknown kind");
}

}  // namespace dsorb
