// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <yaml-cpp/node/node.h>

#include <string>

namespace dsorb::io {

/// The only document of a YAML text as a tree; a null node where the text holds none. Depth,
/// number of values and aliases are checked before anything is built.
/// @param name of the file, for messages
/// @throws IoError naming file and line
[[nodiscard]] YAML::Node parseYaml(const std::string& text, const std::string& name);

}  // namespace dsorb::io
