// SPDX-License-Identifier: BSD-3-Clause
#include "io/calibration/yaml_text.h"

#include "dsorb/error.h"

#include "io/text_file.h"

#include <fmt/format.h>
#include <yaml-cpp/eventhandler.h>
#include <yaml-cpp/yaml.h>

#include <map>
#include <set>
#include <sstream>
#include <string_view>
#include <vector>

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

constexpr std::size_t kMaxDepth = 32;  // groups within groups

/// Follows the parser through a document without building it.
class StructureCheck : public YAML::EventHandler {
 public:
  StructureCheck(const std::string& name, std::size_t most_values)
      : name_(name), most_values_(most_values) {}

  /// Whether the document holds anything.
  [[nodiscard]] bool empty() const { return values_ == 0; }
  /// Where what the document holds begins, from 1.
  [[nodiscard]] int line() const { return line_; }

  void OnDocumentStart(const YAML::Mark& /*mark*/) override {}
  void OnDocumentEnd() override {}
  void OnNull(const YAML::Mark& mark, YAML::anchor_t /*anchor*/) override {
    if (line_ == 0) line_ = mark.line + 1;
  }
  void OnScalar(const YAML::Mark& mark,
                const std::string& /*tag*/,
                YAML::anchor_t anchor,
                const std::string& /*value*/) override {
    if (anchor != 0) sizes_[anchor] = 1;
    add(mark, 1);
  }
  void OnAlias(const YAML::Mark& mark, YAML::anchor_t anchor) override {
    const auto size = sizes_.find(anchor);
    if (size == sizes_.end()) throw error(mark, "an alias stands for the group it is part of");
    add(mark, size->second);
  }
  void OnSequenceStart(const YAML::Mark& mark,
                       const std::string& /*tag*/,
                       YAML::anchor_t anchor,
                       YAML::EmitterStyle::value /*style*/) override {
    open(mark, anchor);
  }
  void OnSequenceEnd() override { close(); }
  void OnMapStart(const YAML::Mark& mark,
                  const std::string& /*tag*/,
                  YAML::anchor_t anchor,
                  YAML::EmitterStyle::value /*style*/) override {
    open(mark, anchor);
  }
  void OnMapEnd() override { close(); }

 private:
  struct Group {
    YAML::anchor_t anchor;
    std::size_t values_before;
  };
  [[nodiscard]] IoError error(const YAML::Mark& mark, const std::string& what) const {
    return lineError(name_, mark.line + 1, what);
  }
  void add(const YAML::Mark& mark, std::size_t values) {
    if (line_ == 0) line_ = mark.line + 1;
    values_ += values;
    if (values_ > most_values_) {
      throw error(
          mark,
          fmt::format("more than {} values, counted with what aliases stand for", most_values_));
    }
  }
  void open(const YAML::Mark& mark, YAML::anchor_t anchor) {
    groups_.push_back({anchor, values_});
    if (groups_.size() > kMaxDepth) {
      throw error(mark, fmt::format("more than {} groups within each other", kMaxDepth));
    }
    add(mark, 1);
  }
  void close() {
    const Group group = groups_.back();
    groups_.pop_back();
    if (group.anchor != 0) sizes_[group.anchor] = values_ - group.values_before;
  }

  std::string name_;
  std::size_t most_values_;
  std::vector<Group> groups_;                    // those open now
  std::map<YAML::anchor_t, std::size_t> sizes_;  // values of closed groups that have an anchor
  std::size_t values_ = 0;
  int line_ = 0;
};

/// Without the mark that ends a document, which the tools of ROS write behind each.
std::string withoutLastMark(const std::string& text) {
  constexpr std::string_view kMark = "\n---";
  const std::size_t end = text.find_last_not_of(" \t\r\n") + 1;
  const bool marked =
      end > kMark.size() && text.compare(end - kMark.size(), kMark.size(), kMark) == 0;
  return text.substr(0, marked ? end - kMark.size() + 1 : text.size());
}

/// @throws IoError on what the tree must not hold, and on more than one document. Where a document
/// cannot begin with a token, for example a comma, the parser stays there and finds empty documents
/// without end: a second one is enough to know.
void check(const std::string& text, const std::string& name, std::size_t most_values) {
  std::istringstream stream(text);
  YAML::Parser parser(stream);
  StructureCheck first(name, most_values);
  if (!parser.HandleNextDocument(first)) return;
  StructureCheck second(name, most_values);
  if (!parser.HandleNextDocument(second)) return;
  throw lineError(name,
                  second.line(),
                  second.empty() ? "not YAML: neither a key nor a value can begin here"
                                 : "a second document begins; expected one");
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

YAML::Node parseYaml(const std::string& whole, const std::string& name, std::size_t most_values) {
  const std::string text = withoutLastMark(whole);
  try {
    check(text, name, most_values);
    return YAML::Load(text);
  } catch (const YAML::Exception& error) {
    throw lineError(name,
                    error.mark.is_null() ? 0 : error.mark.line + 1,
                    fmt::format("not YAML: {}", error.msg));
  }
}

}  // namespace dsorb::io
