// SPDX-License-Identifier: BSD-3-Clause
#include "io/calibration/keyed_values.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <tinyxml2.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
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
class YamlValues {
 public:
  YamlValues(KeyedValues& values, std::size_t most_values)
      : values_(values), most_values_(most_values) {}

  void add(const std::string& path, const YAML::Node& node, int depth = 0) {
    count_ += node.IsSequence() ? 1 + node.size() : 1;
    if (count_ > most_values_) {
      throw error(
          node,
          fmt::format("more than {} values, counted with what aliases stand for", most_values_));
    }
    if (depth > kMaxDepth) {
      throw error(node, fmt::format("more than {} groups within each other", kMaxDepth));
    }
    if (node.IsMap()) {
      for (const auto& entry : node) {
        if (!entry.first.IsScalar()) throw error(entry.first, "not YAML: a key is expected");
        add(joined(path, entry.first.Scalar()), entry.second, depth + 1);
      }
    } else if (node.IsSequence()) {
      addList(path, node, depth);
    } else {
      const auto kind = node.IsScalar() ? KeyedValue::kScalar : KeyedValue::kNull;
      values_.add(path, {{node.Scalar()}, lineOf(node), kind});
    }
  }

 private:
  static int lineOf(const YAML::Node& node) { return node.Mark().line + 1; }
  [[nodiscard]] IoError error(const YAML::Node& node, const std::string& what) const {
    return lineError(values_.file(), lineOf(node), what);
  }
  void addList(const std::string& path, const YAML::Node& list, int depth) {
    KeyedValue value{{}, lineOf(list), KeyedValue::kList};
    int place = 0;
    for (const auto& item : list) {
      if (item.IsScalar()) value.words.push_back(item.Scalar());
      if (item.IsMap() || item.IsSequence()) {
        add(fmt::format("{}[{}]", path, place), item, depth + 1);
      }
      ++place;
    }
    values_.add(path, value);
  }

  KeyedValues& values_;
  std::size_t most_values_;
  std::size_t count_ = 0;
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

bool KeyedValues::has(const std::string& key) const {
  const auto value = values_->find(prefix_ + key);
  return value != values_->end() && value->second.kind != KeyedValue::kNull;
}

bool KeyedValues::hasPath(const std::string& path) const {
  return has(path) || !within(path).empty();
}

std::string KeyedValues::find(const std::vector<std::string>& spellings) const {
  const auto found = std::find_if(
      spellings.begin(), spellings.end(), [this](const std::string& key) { return has(key); });
  return found == spellings.end() ? std::string() : *found;
}

const KeyedValue& KeyedValues::at(const std::string& key) const {
  const KeyedValue& value = values_->at(prefix_ + key);
  if (value.again != 0) throw lineError(file_, value.again, prefix_ + key + ": is there twice");
  return value;
}

std::string KeyedValues::text(const std::string& key, const std::string& what) const {
  if (!has(key)) throw error(key, what + " is expected");
  return fmt::format("{}", fmt::join(at(key).words, " "));
}

double KeyedValues::number(const std::string& key) const {
  return numbers(key, 1, "a number").front();
}

std::vector<double> KeyedValues::numbers(const std::string& key) const {
  std::vector<double> result;
  if (!has(key)) return result;
  for (const std::string& word : at(key).words) {
    double value = 0;
    if (!parseNumber(word, value)) {
      throw error(
          key,
          fmt::format("entry {}, '{}', is not a finite number", result.size() + 1, quotable(word)));
    }
    result.push_back(value);
  }
  return result;
}

std::vector<double> KeyedValues::numbers(const std::string& key,
                                         std::size_t count,
                                         const std::string& what) const {
  std::vector<double> result = numbers(key);
  if (result.size() == count) return result;
  throw error(key, fmt::format("{} numbers; expected {}", result.size(), what));
}

IoError KeyedValues::error(const std::string& key, const std::string& what) const {
  const auto value = values_->find(prefix_ + key);
  return lineError(file_,
                   value == values_->end() ? 0 : value->second.line,
                   key.empty() ? what : fmt::format("{}{}: {}", prefix_, key, what));
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
                      fmt::format("{}a mapping is expected, lines of 'key: value'",
                                  root.IsNull() ? "not YAML: " : ""));
    }
    YamlValues(values, most_values).add("", root);
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
  if (root == nullptr) throw lineError(file, 0, "an XML file of OpenCV is expected");
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
      if (value.again != 0)
        throw lineError(name, value.again, fmt::format("key '{}' is given twice", key));
      if (value.kind != KeyedValue::kScalar) {
        throw values.error(key, "expected a single value or a group of indented keys");
      }
      assignments.push_back({key, value.words.front(), fmt::format("{}:{}", name, value.line)});
    }
    return assignments;
  } catch (const IoError& error) {
    throw ConfigError(error.what());
  }
}

}  // namespace dsorb::io
