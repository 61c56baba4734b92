// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/error.h"
#include "dsorb/options/initializer.h"

namespace dsorb {

std::vector<std::string> initializerVariants() { return {"orb", "orb-v1"}; }

InitializerOptions initializerVariant(const std::string& name) {
  if (name == "orb" || name == "orb-v1") return {};
  throw ConfigError("initializer '" + name + "': this version has orb and orb-v1");
}

}  // namespace dsorb
