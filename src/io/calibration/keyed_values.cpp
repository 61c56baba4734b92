// SPDX-License-Identifier: BSD-3-Clause
#include "io/calibration/keyed_values.h"

#include "io/calibration/yaml_text.h"
#include "io/text_file.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <tinyxml2.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <string_view>
#include <utility>

namespace dsorb::io {
namespace {

constexpr std::size_t kMaxWords = 64;  // of a list; none that is read has more than 14

std::string joined(const std::string& path, const std::string& key) {
  return path.empty() ? key : path + "." + key;
}

std::string entry(const std::string& path, std::size_t index) {
  return fmt::format("{}[{}]", path, index);
}

void addNode(const std::string& path, const YAML::Node& node, KeyedValues& values) {
  const int line = node.Mark().line + 1;
  if (node.IsScalar()) values.add(path, {{node.Scalar()}, line});
  if (node.IsMap()) {
    for (const auto& pair : node) {
      if (pair.first.IsScalar()) addNode(joined(path, pair.first.Scalar()), pair.second, values);
    }
  }
  if (!node.IsSequence()) return;
  values.add(path, {{}, line});
  std::size_t index = 0;
  for (const YAML::Node& item : node) {
    if (item.IsScalar()) values.append(path, item.Scalar());
    if (!item.IsScalar()) addNode(entry(path, index), item, values);
    ++index;
  }
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

void KeyedValues::add(const std::string& key, KeyedValue value) {
  const auto [place, is_new] = values_->try_emplace(key, std::move(value));
  place->second.twice = !is_new;
}

void KeyedValues::append(const std::string& key, const std::string& word) {
  std::vector<std::string>& words = (*values_)[key].words;
  if (words.size() <= kMaxWords) words.push_back(word);
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
  return values_->count(prefix_ + key) > 0;
}

bool KeyedValues::hasPath(const std::string& path) const {
  return has(path) || !within(path).empty();
}

std::string KeyedValues::find(const std::vector<const char*>& spellings) const {
  const auto found = std::find_if(
      spellings.begin(), spellings.end(), [this](const char* key) { return has(key); });
  return found == spellings.end() ? std::string() : *found;
}

const KeyedValue& KeyedValues::at(const std::string& key) const {
  const KeyedValue& value = values_->at(prefix_ + key);
  if (value.twice) throw error(key, "is there twice");
  return value;
}

std::string KeyedValues::text(const std::string& key, const std::string& what) const {
  if (!has(key)) throw error(key, fmt::format("{} is expected", what));
  return fmt::format("{}", fmt::join(at(key).words, " "));
}

double KeyedValues::number(const std::string& key) const {
  return numbers(key, {1}, "a number").front();
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
                                         const std::vector<std::size_t>& counts,
                                         const std::string& what) const {
  std::vector<double> result = numbers(key);
  if (std::find(counts.begin(), counts.end(), result.size()) != counts.end()) return result;
  throw error(key, fmt::format("{} numbers; expected {}", result.size(), what));
}

IoError KeyedValues::error(const std::string& key, const std::string& what) const {
  const auto value = values_->find(prefix_ + key);
  return lineError(file_,
                   value == values_->end() ? 0 : value->second.line,
                   key.empty() ? what : fmt::format("{}{}: {}", prefix_, key, what));
}

KeyedValues yamlValues(const std::filesystem::path& file, const YamlLimits& limits) {
  // cv::FileStorage begins a file with "%YAML:1.0", which is no YAML. Line numbers stay.
  constexpr std::string_view kHeader = "%YAML:";
  std::string document = readText(file, limits.bytes);
  if (document.compare(0, kHeader.size(), kHeader) == 0) document.front() = '#';
  const YAML::Node root = parseYaml(document, file.string(), limits.values);
  if (!root.IsMap()) {
    throw lineError(file, 0, "a mapping is expected, as docs/calibration.md shows");
  }
  KeyedValues values(file);
  addNode("", root, values);
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

}  // namespace dsorb::io
