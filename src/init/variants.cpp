// SPDX-License-Identifier: BSD-3-Clause
#include "init/variants.h"

#include "dsorb/error.h"
#include "dsorb/options/initializer.h"

#include "init/registry.h"

#include <algorithm>

namespace dsorb {
namespace {

bool contains(const std::vector<std::string>& names, const std::string& name) {
  return std::find(names.begin(), names.end(), name) != names.end();
}

}  // namespace

std::vector<std::string> builtInVariants() {
  return {"coarse", "orb"};
}

std::vector<std::string> initializerVariants() {
  std::vector<std::string> names = builtInVariants();
  const std::vector<std::string> registered = registeredInitializers();
  names.insert(names.end(), registered.begin(), registered.end());
  return names;
}

void throwUnknownVariant(const std::string& name) {
  std::string text = "initializer '" + name + "': this version has";
  if (isPublishedVariant(name)) {
    text = "initializer '" + name +
           "' comes with dsorb::published, which needs a build with Ceres (DSORB_WITH_CERES=ON); "
           "this program has";
  }
  for (const std::string& variant : initializerVariants()) text += " " + variant;
  throw ConfigError(text);
}

InitializerOptions initializerVariant(const std::string& name) {
  if (!contains(initializerVariants(), name)) throwUnknownVariant(name);
  InitializerOptions options;
  if (name == "coarse") {
    options.kind = InitializerKind::kCoarse;
  } else if (name != "orb") {
    options.kind = InitializerKind::kRegistered;
    options.registered = name;
  }
  return options;
}

}  // namespace dsorb
