// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/error.h"
#include "dsorb/init/initializer.h"
#include "dsorb/init/registry.h"
#include "dsorb/options/initializer.h"

#include "base/describe.h"
#include "init/coarse/coarse_initializer.h"
#include "init/orb/orb_initializer.h"

#include <algorithm>
#include <map>
#include <mutex>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace dsorb {
namespace {

bool contains(const std::vector<std::string>& names, const std::string& name) {
  return std::find(names.begin(), names.end(), name) != names.end();
}

/// Names of the variants that dsorb::init itself has.
std::vector<std::string> builtInVariants() {
  return {"coarse", "orb"};
}

struct Registry {
  std::mutex mutex;
  std::map<std::string, InitializerFactory> factories;
};

/// Made by the first registration, hence still there when a static registration ends.
Registry& registry() {
  static Registry the_registry;
  return the_registry;
}

/// Names of the kinds that libraries brought, in alphabetical order.
std::vector<std::string> registeredInitializers() {
  Registry& known = registry();
  const std::lock_guard<std::mutex> lock(known.mutex);
  std::vector<std::string> names;
  names.reserve(known.factories.size());
  for (const auto& entry : known.factories) names.push_back(entry.first);
  return names;
}

/// @throws ConfigError why there is no such variant, and which ones there are
[[noreturn]] void throwUnknownVariant(const std::string& name) {
  std::string text = "initializer '" + name + "': this version has";
  if (isPublishedVariant(name)) {
    text = "initializer '" + name +
           "' comes with dsorb::published, which needs a build with Ceres (DSORB_WITH_CERES=ON); "
           "this program has";
  }
  for (const std::string& variant : initializerVariants()) text += " " + variant;
  throw ConfigError(text);
}

/// @throws ConfigError naming the initializers there are
InitializerFactory registeredFactory(const std::string& name) {
  {
    Registry& known = registry();
    const std::lock_guard<std::mutex> lock(known.mutex);
    const auto found = known.factories.find(name);
    if (found != known.factories.end()) return found->second;
  }
  throwUnknownVariant(name);
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

std::vector<std::string> initializerVariants() {
  std::vector<std::string> names = builtInVariants();
  const std::vector<std::string> registered = registeredInitializers();
  names.insert(names.end(), registered.begin(), registered.end());
  return names;
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

RegisteredInitializer::RegisteredInitializer(std::string name, InitializerFactory factory)
    : name_(std::move(name)) {
  if (name_.empty()) throw std::invalid_argument("an initializer needs a name");
  if (!factory) throw std::invalid_argument("initializer '" + name_ + "' has no factory");
  Registry& known = registry();
  const std::lock_guard<std::mutex> lock(known.mutex);
  if (contains(builtInVariants(), name_) ||
      !known.factories.emplace(name_, std::move(factory)).second) {
    throw std::invalid_argument("there is an initializer '" + name_ + "' already");
  }
}

RegisteredInitializer::~RegisteredInitializer() {
  Registry& known = registry();
  const std::lock_guard<std::mutex> lock(known.mutex);
  known.factories.erase(name_);
}

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
      return init_orb::makeOrbInitializer(options, camera);
    case InitializerKind::kCoarse:
      return init_coarse::makeCoarseInitializer(options, camera);
    case InitializerKind::kRegistered:
      return makeRegistered(options, camera);
  }
  throw ConfigError("initializer of unknown kind");
}

}  // namespace dsorb
