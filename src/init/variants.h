// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

namespace dsorb {

/// Names of the variants that dsorb::init itself has.
[[nodiscard]] std::vector<std::string> builtInVariants();

/// @throws ConfigError why there is no such variant, and which ones there are
[[noreturn]] void throwUnknownVariant(const std::string& name);

}  // namespace dsorb
