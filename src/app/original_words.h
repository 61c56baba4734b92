// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "app/command_line.h"

#include <string>
#include <vector>

namespace dsorb::app {

/// Whether a free word of the command line is meant as `key=value` and not as a path.
[[nodiscard]] bool looksLikeOriginalWord(const std::string& word);

/// Applies the original program's `key=value` words, a later one overriding an earlier.
/// @throws ConfigError on an unknown word, a malformed value, or what this version lacks
/// @source front-end specification, section 10.1
void applyOriginalWords(const std::vector<std::string>& words, CommandLine& command_line);

}  // namespace dsorb::app
