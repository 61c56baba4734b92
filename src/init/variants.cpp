// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/error.h"
#include "dsorb/options/initializer.h"

namespace dsorb {

std::vector<std::string> initializerVariants() {
  return {"coarse", "orb", "orb-v1", "orb-matching"};
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
  if (name == "orb-matching") {
    InitializerOptions options;
    options.orb.front_end = OrbFrontEnd::kDescriptors;
    options.orb.two_view.model_choice = ModelChoice::kInliers;
    options.orb.geometric.solver = GeometricSolver::kCeres;
    return options;
  }
  std::string known;
  for (const std::string& variant : initializerVariants()) known += " " + variant;
  throw ConfigError("initializer '" + name + "': this version has" + known);
}

}  // namespace dsorb
