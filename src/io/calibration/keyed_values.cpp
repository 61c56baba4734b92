// SPDX-License-Identifier: BSD-3-Clause
#include "io/calibration/keyed_values.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <tinyxml2.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <optional>
#include <sstream>
#include <string_view>
#include <utility>

namespace dsorb::io {
namespace {

constexpr int kMaxDepth = 32;  // groups within groups

std::string joined(const std::string& path, const std::string& key) {
  return path.empty() ? key : path + "." + key;
}

/// Notes the values of a document under their paths.
struct YamlReader {
  KeyedValues& values;
  std::size_t most_values;
  std::size_t count = 0;

  void add(const std::string& path, const YAML::Node& node, int depth = 0) {
    const int line = node.Mark().line + 1;
    count += node.IsSequence() ? 1 + node.size() : 1;
    if (count > most_values) {
      throw lineError(values.file(),
                      line,
                      "more than {} values, counted with what aliases stand for",
                      most_values);
    }
    if (depth > kMaxDepth) {
      throw lineError(values.file(), line, "more than {} groups within each other", kMaxDepth);
    }
    if (node.IsMap()) {
      for (const auto& entry : node) {
        if (!entry.first.IsScalar()) {
          throw lineError(values.file(),
                          entry.first.Mark().line + 1,
                          std::string("not YAML: a key is expected"));
        }
        add(joined(path, entry.first.Scalar()), entry.second, depth + 1);
      }
    } else if (node.IsSequence()) {
      KeyedValue list{{}, line, KeyedValue::kList};
      int place = 0;
      for (const auto& item : node) {
        if (item.IsScalar()) list.words.push_back(item.Scalar());
        if (item.IsMap() || item.IsSequence()) {
          add(fmt::format("{}[{}]", path, place), item, depth + 1);
        }
        ++place;
      }
      values.add(path, list);
    } else {
      const auto kind = node.IsScalar() ? KeyedValue::kScalar : KeyedValue::kNull;
      values.add(path, {{node.Scalar()}, line, kind});
    }
  }
};

/// Lines where documents begin to have content; 0: there is none.
struct Documents {
  int first = 0;
  int second = 0;
};

Documents documentsIn(const std::string& text) {
  Documents documents;
  std::istringstream lines(text);
  int number = 0;
  bool ended = false;
  for (std::string line; documents.second == 0 && std::getline(lines, line);) {
    ++number;
    std::string_view content = line;
    const bool mark = trimmed(content.substr(0, 4)) == "---" || trimmed(content) == "...";
    if (mark) content.remove_prefix(3);
    ended = ended || (mark && documents.first > 0);
    content = trimmed(content);
    if (content.empty() || content.front() == '#' || content.front() == '%') continue;
    if (documents.first == 0) documents.first = number;
    if (ended) documents.second = number;
  }
  return documents;
}

/// Matrices have their numbers in an element `data`.
void addElement(const std::string& path, const tinyxml2::XMLElement& element, KeyedValues& values) {
  if (element.GetText() != nullptr) {
    values.add(path, {splitWords(element.GetText()), element.GetLineNum()});
  }
  for (auto* child = element.FirstChildElement(); child != nullptr;
       child = child->NextSiblingElement()) {
    addElement(joined(path, child->Name()), *child, values);
  }
}

}  // namespace

std::vector<std::string> spellings(std::string_view words) {
  std::vector<std::string> result(1);
  for (const char c : words) {
    if (c == '|') {
      result.emplace_back();
    } else {
      result.back() += c;
    }
  }
  return result;
}

KeyedValues::KeyedValues(std::filesystem::path file)
    : file_(std::move(file)), values_(std::make_shared<std::map<std::string, KeyedValue>>()) {}

void KeyedValues::add(const std::string& key, const KeyedValue& value) {
  const auto [place, is_new] = values_->try_emplace(key, value);
  if (!is_new) place->second.again = value.line;
}

KeyedValues KeyedValues::within(const std::string& path) const {
  KeyedValues result = *this;
  if (!path.empty()) result.prefix_ += path + ".";
  return result;
}

bool KeyedValues::empty() const {
  const auto first = values_->lower_bound(prefix_);
  return first == values_->end() || first->first.compare(0, prefix_.size(), prefix_) != 0;
}

bool KeyedValues::has(const std::string& path) const {
  return (*this)[path].has() || !within(path).empty();
}

Field KeyedValues::operator[](std::string_view spellings) const {
  std::optional<Field> none;
  for (const std::string& key : io::spellings(spellings)) {
    for (const std::string& path : {prefix_ + key, prefix_ + key + ".data"}) {
      const auto found = values_->find(path);
      const bool there = found != values_->end();
      Field field{file_, path, there ? found->second : KeyedValue{{}, 0, KeyedValue::kNull}};
      if (field.has()) return field;
      if (!none) none = std::move(field);
    }
  }
  return *none;
}

std::string Field::text(std::string_view what) const {
  if (!has()) throw error("{} is expected", what);
  if (content.again != 0) throw lineError(file, content.again, "{}: is there twice", key);
  return fmt::format("{}", fmt::join(content.words, " "));
}

std::vector<double> Field::numbers() const {
  std::vector<double> result;
  if (!has()) return result;
  if (content.again != 0) throw lineError(file, content.again, "{}: is there twice", key);
  for (const std::string& word : content.words) {
    if (!parseNumber(word, result.emplace_back())) {
      throw error("entry {}, '{}', is not a finite number", result.size(), quotable(word));
    }
  }
  return result;
}

std::vector<double> Field::numbers(std::size_t count, std::string_view what) const {
  if (!has()) throw error("is missing; expected {}", what);
  std::vector<double> result = numbers();
  if (result.size() != count) throw error("{} numbers; expected {}", result.size(), what);
  return result;
}

/// The first line of cv::FileStorage, "%YAML:1.0", is no YAML.
KeyedValues yamlValues(const std::string& text,
                       const std::filesystem::path& name,
                       std::size_t most_values) {
  KeyedValues values(name);
  const Documents documents = documentsIn(text);
  if (documents.second > 0) {
    throw lineError(name, documents.second, "a second document begins; expected one");
  }
  if (documents.first == 0) return values;
  try {
    const YAML::Node root = YAML::Load(text.rfind("%YAML:", 0) == 0 ? "#" + text : text);
    if (!root.IsMap()) {
      throw lineError(name,
                      documents.first,
                      "{}a mapping is expected, lines of 'key: value'",
                      root.IsNull() ? "not YAML: " : "");
    }
    YamlReader{values, most_values}.add("", root);
  } catch (const YAML::Exception& error) {
    throw lineError(name, error.mark.is_null() ? 0 : error.mark.line + 1, "not YAML: " + error.msg);
  }
  return values;
}

KeyedValues xmlValues(const std::filesystem::path& file, const std::string& text) {
  tinyxml2::XMLDocument document;
  if (document.Parse(text.data(), text.size()) != tinyxml2::XML_SUCCESS) {
    throw lineError(file, document.ErrorLineNum(), "no XML");
  }
  const tinyxml2::XMLElement* root = document.FirstChildElement("opencv_storage");
  if (root == nullptr) throw fileError(file, "an XML file of OpenCV is expected");
  KeyedValues values(file);
  addElement("", *root, values);
  return values;
}

std::vector<ConfigAssignment> readYamlAssignments(const std::string& text,
                                                  const std::string& name) {
  try {
    const KeyedValues values = yamlValues(text, name);
    std::vector<std::pair<std::string, KeyedValue>> in_order(values.all().begin(),
                                                             values.all().end());
    std::stable_sort(in_order.begin(), in_order.end(), [](const auto& a, const auto& b) {
      return a.second.line < b.second.line;
    });
    std::vector<ConfigAssignment> assignments;
    for (const auto& [key, value] : in_order) {
      if (value.again != 0) throw lineError(name, value.again, "key '{}' is given twice", key);
      if (value.kind != KeyedValue::kScalar) {
        throw values[key].error("expected a single value or a group of indented keys");
      }
      assignments.push_back({key, value.words.front(), fmt::format("{}:{}", name, value.line)});
    }
    return assignments;
  } catch (const IoError& error) {
    throw ConfigError(error.what());
  }
}

}  // namespace dsorb::io
