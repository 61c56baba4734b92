// SPDX-License-Identifier: BSD-3-Clause
#include "init/registry.h"

#include "init/variants.h"

#include <algorithm>
#include <map>
#include <mutex>
#include <stdexcept>
#include <utility>

namespace dsorb {
namespace {

struct Registry {
  std::mutex mutex;
  std::map<std::string, InitializerFactory> factories;
};

/// Made by the first registration, hence still there when a static registration ends.
Registry& registry() {
  static Registry the_registry;
  return the_registry;
}

bool isBuiltIn(const std::string& name) {
  const std::vector<std::string> names = builtInVariants();
  return std::find(names.begin(), names.end(), name) != names.end();
}

}  // namespace

RegisteredInitializer::RegisteredInitializer(std::string name, InitializerFactory factory)
    : name_(std::move(name)) {
  if (name_.empty()) throw std::invalid_argument("an initializer needs a name");
  if (!factory) throw std::invalid_argument("initializer '" + name_ + "' has no factory");
  Registry& known = registry();
  const std::lock_guard<std::mutex> lock(known.mutex);
  if (isBuiltIn(name_) || !known.factories.emplace(name_, std::move(factory)).second) {
    throw std::invalid_argument("there is an initializer '" + name_ + "' already");
  }
}

RegisteredInitializer::~RegisteredInitializer() {
  Registry& known = registry();
  const std::lock_guard<std::mutex> lock(known.mutex);
  known.factories.erase(name_);
}

std::vector<std::string> registeredInitializers() {
  Registry& known = registry();
  const std::lock_guard<std::mutex> lock(known.mutex);
  std::vector<std::string> names;
  names.reserve(known.factories.size());
  for (const auto& entry : known.factories) names.push_back(entry.first);
  return names;
}

InitializerFactory registeredFactory(const std::string& name) {
  {
    Registry& known = registry();
    const std::lock_guard<std::mutex> lock(known.mutex);
    const auto found = known.factories.find(name);
    if (found != known.factories.end()) return found->second;
  }
  throwUnknownVariant(name);
}

}  // namespace dsorb
