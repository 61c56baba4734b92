// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/error.h"
#include "dsorb/io/config.h"

#include "io/text_file.h"

#include <fmt/format.h>

#include <cstddef>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace dsorb::io {

/// A scalar or a list of scalars of a file, as words.
struct KeyedValue {
  enum Kind { kScalar, kList, kNull };

  std::vector<std::string> words;
  int line = 0;  ///< from 1; 0: not known
  Kind kind = kScalar;
  int again = 0;  ///< line where the file has its key again; 0: it has not
};

/// The words between bars: "width|w" are two.
[[nodiscard]] std::vector<std::string> spellings(std::string_view words);

struct Field;

/// Scalars and lists of a YAML, JSON or XML file by the whole path of their keys, as in
/// "cameras[0].camera.label". A copy shares them.
class KeyedValues {
 public:
  explicit KeyedValues(std::filesystem::path file);

  /// A key that comes again is told to whoever asks for its value.
  void add(const std::string& key, const KeyedValue& value);
  [[nodiscard]] const std::map<std::string, KeyedValue>& all() const { return *values_; }

  /// Those whose keys begin with a path and a dot, by what follows.
  [[nodiscard]] KeyedValues within(const std::string& path) const;
  [[nodiscard]] bool empty() const;
  /// Whether there is a value or a group of this path.
  [[nodiscard]] bool has(const std::string& path) const;
  /// The value of a key, there or not; of several spellings the first that is there, or else the
  /// first. A list may be a group that has it as `data`.
  [[nodiscard]] Field operator[](std::string_view spellings) const;
  [[nodiscard]] const std::filesystem::path& file() const { return file_; }

 private:
  std::filesystem::path file_;
  std::string prefix_;
  std::shared_ptr<std::map<std::string, KeyedValue>> values_;
};

/// The value of one key, for those who read it and complain of it: with file, line and key.
struct Field {
  std::filesystem::path file;
  std::string key;     ///< with its whole path
  KeyedValue content;  ///< null where there is none

  [[nodiscard]] bool has() const { return content.kind != KeyedValue::kNull; }
  /// Words with spaces between them.
  /// @param what is expected, for the complaint where there is none
  [[nodiscard]] std::string text(std::string_view what) const;
  [[nodiscard]] std::vector<double> numbers() const;
  /// @param count how many there must be
  [[nodiscard]] std::vector<double> numbers(std::size_t count, std::string_view what) const;
  [[nodiscard]] double number() const { return numbers(1, "a number").front(); }

  template <typename... Parts>
  [[nodiscard]] IoError error(std::string_view what, const Parts&... parts) const {
    return lineError(file,
                     content.line,
                     (key.empty() ? "" : key + ": ") + fmt::format(fmt::runtime(what), parts...));
  }
};

/// Most values that are read of a file, aliases counted as what they stand for.
inline constexpr std::size_t kMaxYamlValues = 100000;

/// Values of the only document of a YAML text; none where it holds nothing. JSON is a part of YAML.
/// Depth, number of values and aliases are limited before memory is taken for them.
/// @param name of the file, for messages
/// @throws IoError naming file and line
[[nodiscard]] KeyedValues yamlValues(const std::string& text,
                                     const std::filesystem::path& name,
                                     std::size_t most_values = kMaxYamlValues);
/// Values of an XML file that cv::FileStorage wrote.
[[nodiscard]] KeyedValues xmlValues(const std::filesystem::path& file, const std::string& text);

/// Nested YAML maps as dotted keys, in the order written, each with "<name>:<line>".
/// @throws ConfigError naming the line, on anything but maps of scalars and on a key given twice
[[nodiscard]] std::vector<ConfigAssignment> readYamlAssignments(const std::string& text,
                                                                const std::string& name);

}  // namespace dsorb::io
