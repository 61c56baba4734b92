// SPDX-License-Identifier: BSD-3-Clause
#include "io/calibration/keyed_values.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <tinyxml2.h>
#include <yaml-cpp/eventhandler.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <optional>
#include <sstream>
#include <string_view>
#include <utility>

namespace dsorb::io {
namespace {

constexpr std::size_t kMaxWords = 64;  // of a list; none that is read has more than 14
constexpr std::size_t kMaxDepth = 32;  // groups within groups

std::string joined(const std::string& path, const std::string& key) {
  return path.empty() ? key : path + "." + key;
}

/// Notes the values of a document as the parser finds them.
class YamlValues : public YAML::EventHandler {
 public:
  YamlValues(KeyedValues& values, std::size_t most_values)
      : values_(values), most_values_(most_values) {}

  /// Whether the document holds anything.
  [[nodiscard]] bool empty() const { return count_ == 0; }
  /// Where what the document holds begins, from 1.
  [[nodiscard]] int line() const { return line_; }

  void OnDocumentStart(const YAML::Mark& /*mark*/) override {}
  void OnDocumentEnd() override {}
  void OnNull(const YAML::Mark& mark, YAML::anchor_t anchor) override {
    if (line_ == 0) line_ = mark.line + 1;
    if (!groups_.empty()) addScalar(mark, {std::nullopt, {}}, anchor);
  }
  void OnScalar(const YAML::Mark& mark,
                const std::string& /*tag*/,
                YAML::anchor_t anchor,
                const std::string& value) override {
    addScalar(mark, {value, {}}, anchor);
  }
  void OnAlias(const YAML::Mark& mark, YAML::anchor_t name) override {
    const auto anchor = anchors_.find(name);
    if (anchor == anchors_.end()) {
      throw error(mark, "an alias stands for the group it is part of");
    }
    if (anchor->second.path.empty()) {
      addScalar(mark, anchor->second, 0);
    } else {
      count(mark, values_.copy(anchor->second.path, begin(mark)));
    }
  }
  void OnSequenceStart(const YAML::Mark& mark,
                       const std::string& /*tag*/,
                       YAML::anchor_t anchor,
                       YAML::EmitterStyle::value /*style*/) override {
    open(mark, anchor, false);
    if (groups_.size() > 1) {
      values_.add(groups_.back().path, {{}, mark.line + 1, KeyedValue::kList});
    }
  }
  void OnSequenceEnd() override { close(); }
  void OnMapStart(const YAML::Mark& mark,
                  const std::string& /*tag*/,
                  YAML::anchor_t anchor,
                  YAML::EmitterStyle::value /*style*/) override {
    open(mark, anchor, true);
  }
  void OnMapEnd() override { close(); }

 private:
  struct Group {
    std::string path;
    YAML::anchor_t anchor;
    bool is_map;
    std::size_t items;               // so far
    std::optional<std::string> key;  // of a map, whose value comes next
  };
  /// What an alias may stand for: a scalar, or the group of a path.
  struct Anchor {
    std::optional<std::string> scalar;
    std::string path;
  };

  [[nodiscard]] IoError error(const YAML::Mark& mark, const std::string& what) const {
    return lineError(values_.file(), mark.line + 1, what);
  }
  void count(const YAML::Mark& mark, std::size_t values) {
    if (line_ == 0) line_ = mark.line + 1;
    count_ += values;
    if (count_ <= most_values_) return;
    throw error(
        mark,
        fmt::format("more than {} values, counted with what aliases stand for", most_values_));
  }
  /// @return path of the value that begins
  std::string begin(const YAML::Mark& mark) {
    count(mark, 1);
    if (groups_.empty()) return {};
    Group& group = groups_.back();
    if (!group.is_map) return fmt::format("{}[{}]", group.path, group.items++);
    if (!group.key) throw error(mark, "not YAML: a key is expected");
    const std::string path = joined(group.path, *group.key);
    group.key.reset();
    return path;
  }
  void addScalar(const YAML::Mark& mark, const Anchor& value, YAML::anchor_t anchor) {
    if (anchor != 0) anchors_[anchor] = value;
    if (groups_.empty()) throw error(mark, "a mapping is expected, lines of 'key: value'");
    Group& group = groups_.back();
    if (group.is_map && !group.key && value.scalar) {
      group.key = value.scalar;
      return;
    }
    const std::string path = begin(mark);
    if (!group.is_map && value.scalar) values_.append(group.path, *value.scalar);
    if (!group.is_map) return;
    const auto kind = value.scalar ? KeyedValue::kScalar : KeyedValue::kNull;
    values_.add(path, {{value.scalar.value_or("")}, mark.line + 1, kind});
  }
  void open(const YAML::Mark& mark, YAML::anchor_t anchor, bool is_map) {
    if (groups_.size() == kMaxDepth) {
      throw error(mark, fmt::format("more than {} groups within each other", kMaxDepth));
    }
    if (groups_.empty() && !is_map) {
      throw error(mark, "a mapping is expected, lines of 'key: value'");
    }
    std::string path = begin(mark);
    groups_.push_back({std::move(path), anchor, is_map, 0, {}});
  }
  void close() {
    const Group& group = groups_.back();
    if (group.anchor != 0) anchors_[group.anchor] = {std::nullopt, group.path};
    groups_.pop_back();
  }

  KeyedValues& values_;
  std::size_t most_values_;
  std::vector<Group> groups_;                 // those open now
  std::map<YAML::anchor_t, Anchor> anchors_;  // of closed groups and scalars
  std::size_t count_ = 0;
  int line_ = 0;
};

/// Without the mark that ends a document, which the tools of ROS write behind each, and with the
/// first line of cv::FileStorage, "%YAML:1.0", which is no YAML, as a comment.
std::string plainYaml(std::string text) {
  constexpr std::string_view kHeader = "%YAML:";
  constexpr std::string_view kMark = "\n---";
  if (text.compare(0, kHeader.size(), kHeader) == 0) text.front() = '#';
  const std::size_t end = text.find_last_not_of(" \t\r\n") + 1;
  if (end > kMark.size() && text.compare(end - kMark.size(), kMark.size(), kMark) == 0) {
    text.resize(end - kMark.size() + 1);
  }
  return text;
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
  const int line = value.line;
  const auto [place, is_new] = values_->try_emplace(key, std::move(value));
  if (!is_new) place->second.again = line;
}

void KeyedValues::append(const std::string& key, const std::string& word) {
  std::vector<std::string>& words = (*values_)[key].words;
  if (words.size() <= kMaxWords) words.push_back(word);
}

std::size_t KeyedValues::copy(const std::string& from, const std::string& to) {
  std::vector<std::pair<std::string, KeyedValue>> found;
  std::size_t count = 0;
  for (auto at = values_->lower_bound(from);
       at != values_->end() && at->first.compare(0, from.size(), from) == 0;
       ++at) {
    const char next = at->first.c_str()[from.size()];
    if (next != '\0' && next != '.' && next != '[') continue;
    found.emplace_back(to + at->first.substr(from.size()), at->second);
    count += 1 + at->second.words.size();
  }
  for (auto& [key, value] : found) add(key, std::move(value));
  return count;
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

/// Where a document cannot begin with a token, for example a comma, the parser stays there and
/// finds empty documents without end: a second one is enough to know.
KeyedValues yamlValues(const std::string& text,
                       const std::filesystem::path& name,
                       std::size_t most_values) {
  KeyedValues values(name);
  try {
    std::istringstream stream(plainYaml(text));
    YAML::Parser parser(stream);
    YamlValues first(values, most_values);
    if (!parser.HandleNextDocument(first)) return values;
    KeyedValues others(name);
    YamlValues second(others, most_values);
    if (!parser.HandleNextDocument(second)) return values;
    throw lineError(name,
                    second.line(),
                    second.empty() ? "not YAML: neither a key nor a value can begin here"
                                   : "a second document begins; expected one");
  } catch (const YAML::Exception& error) {
    throw lineError(name, error.mark.is_null() ? 0 : error.mark.line + 1, "not YAML: " + error.msg);
  }
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
