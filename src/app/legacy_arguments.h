// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "app/command_line.h"

#include <string>
#include <vector>

namespace dsorb::app {

/// Whether a free word of the command line is meant as `key=value` and not as a path.
[[nodiscard]] bool looksLikeLegacyArgument(const std::string& word);

/// Applies the `key=value` arguments of the original program, DSO's `dso_dataset`, a later one
/// overriding an earlier.
/// @throws ConfigError on an unknown word, a malformed value, or what this version lacks
/// @source "Usage" in the README of DSO
void applyLegacyArguments(const std::vector<std::string>& words, CommandLine& command_line);

}  // namespace dsorb::app
