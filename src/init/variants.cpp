// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/error.h"
#include "dsorb/options/initializer.h"

namespace dsorb {

std::vector<std::string> initializerVariants() {
  return {"coarse", "orb", "orb-v1"};
}

InitializerOptions initializerVariant(const std::string& name) {
  if (name == "coarse") {
    InitializerOptions options;
    options.kind = InitializerKind::kCoarse;
    return options;
  }
  if (name == "orb") return {};
  if (name == "orb-v1") {
    InitializerOptions options;
    options.orb.geometric.solver = GeometricSolver::kCeres;  // as in the report
    return options;
  }
  throw ConfigError("initializer '" + name + "': this version has coarse, orb and orb-v1");
}

}  // namespace dsorb
