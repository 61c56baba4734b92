// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

namespace dsorb {

/// Names of dsorb's own variants, also of those that need Ceres and are not in this build.
[[nodiscard]] std::vector<std::string> builtInVariants();

/// @throws ConfigError why there is no such variant in this build, and which ones there are
[[noreturn]] void throwUnknownVariant(const std::string& name);

}  // namespace dsorb
