// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/init/registry.h"

#include <string>
#include <vector>

namespace dsorb {

/// Names of the kinds that libraries brought, in alphabetical order.
[[nodiscard]] std::vector<std::string> registeredInitializers();

/// @throws ConfigError naming the initializers there are
[[nodiscard]] InitializerFactory registeredFactory(const std::string& name);

}  // namespace dsorb
