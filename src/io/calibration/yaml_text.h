// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/io/config.h"

#include <yaml-cpp/node/node.h>

#include <cstddef>
#include <string>
#include <vector>

namespace dsorb::io {

/// Flattens nested YAML maps to dotted keys, in the order written, each with "<name>:<line>".
/// @throws ConfigError naming the line, on anything but maps of scalars and on a key given twice
[[nodiscard]] std::vector<ConfigAssignment> readYamlAssignments(const std::string& text,
                                                                const std::string& name);

/// The same from a file. @throws ConfigError also when it cannot be read
[[nodiscard]] std::vector<ConfigAssignment> readYamlFile(const std::string& path);

/// Whether `key` ends with `end` at a dot: "b.c" is an end of "a.b.c".
[[nodiscard]] bool isEndOfKey(const std::string& end, const std::string& key);

/// "a.b.c" as its parts.
[[nodiscard]] std::vector<std::string> splitKey(const std::string& key);

inline constexpr std::size_t kMaxYamlValues = 100000;

/// The only document of a YAML text as a tree; a null node where the text holds none. Depth,
/// number of values and aliases are checked before anything is built.
/// @param name        of the file, for messages
/// @param most_values aliases counted as what they stand for
/// @throws IoError naming file and line
[[nodiscard]] YAML::Node parseYaml(const std::string& text,
                                   const std::string& name,
                                   std::size_t most_values = kMaxYamlValues);

}  // namespace dsorb::io
