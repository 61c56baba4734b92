// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <yaml-cpp/node/node.h>

#include <cstddef>
#include <string>

namespace dsorb::io {

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
