// SPDX-License-Identifier: BSD-3-Clause
#include "io/yaml_assignments.h"

#include "dsorb/error.h"

#include "io/calibration/yaml_text.h"
#include "io/text_file.h"

#include <fmt/format.h>
#include <yaml-cpp/yaml.h>

#include <set>
#include <sstream>

namespace dsorb::io {
namespace {

std::string position(const std::string& name, const YAML::Mark& mark) {
  return mark.is_null() ? name : fmt::format("{}:{}", name, mark.line + 1);
}

void flatten(const YAML::Node& node,
             const std::string& prefix,
             const std::string& name,
             std::vector<ConfigAssignment>& assignments) {
  std::set<std::string> seen;
  for (const auto& entry : node) {
    const std::string origin = position(name, entry.first.Mark());
    if (!entry.first.IsScalar()) throw ConfigError(origin + ": expected a key");
    const std::string key = prefix + entry.first.Scalar();
    if (!seen.insert(key).second) {
      throw ConfigError(fmt::format("{}: key '{}' is given twice", origin, key));
    }
    if (entry.second.IsMap()) {
      flatten(entry.second, key + ".", name, assignments);
    } else if (entry.second.IsScalar()) {
      assignments.push_back({key, entry.second.Scalar(), origin});
    } else {
      throw ConfigError(
          fmt::format("{}: {}: expected a single value or a group of indented keys", origin, key));
    }
  }
}

}  // namespace

std::vector<ConfigAssignment> readYamlAssignments(const std::string& text,
                                                  const std::string& name) {
  std::vector<ConfigAssignment> assignments;
  YAML::Node root;
  try {
    root = parseYaml(text, name);
  } catch (const IoError& error) {
    throw ConfigError(error.what());
  }
  if (root.IsNull()) return assignments;
  if (!root.IsMap()) {
    throw ConfigError(position(name, root.Mark()) + ": expected lines of 'key: value'");
  }
  flatten(root, "", name, assignments);
  return assignments;
}

std::vector<ConfigAssignment> readYamlFile(const std::string& path) {
  std::string text;
  try {
    text = readText(path, kMaxYamlBytes);
  } catch (const IoError& error) {
    throw ConfigError(error.what());
  }
  return readYamlAssignments(text, path);
}

bool isEndOfKey(const std::string& end, const std::string& key) {
  return key.size() > end.size() && key[key.size() - end.size() - 1] == '.' &&
         key.compare(key.size() - end.size(), end.size(), end) == 0;
}

std::vector<std::string> splitKey(const std::string& key) {
  std::vector<std::string> parts;
  std::istringstream stream(key);
  for (std::string part; std::getline(stream, part, '.');) parts.push_back(part);
  return parts;
}

}  // namespace dsorb::io
