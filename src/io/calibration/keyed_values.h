// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/error.h"

#include "io/calibration/yaml_text.h"
#include "io/text_file.h"

#include <cstddef>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <vector>

namespace dsorb::io {

/// A scalar or a list of scalars of a file, as words.
struct KeyedValue {
  std::vector<std::string> words;
  int line = 0;        ///< from 1; 0: not known
  bool twice = false;  ///< the file has its key again
};

/// Scalars and lists of a YAML, JSON or XML file by the whole path of their keys, as in
/// "cameras[0].camera.label". Every complaint names file, line and key.
class KeyedValues {
 public:
  explicit KeyedValues(std::filesystem::path file);

  /// A key that comes again is told to whoever asks for its value.
  void add(const std::string& key, KeyedValue value);
  /// Appends to the list of a key.
  void append(const std::string& key, const std::string& word);

  /// Those whose keys begin with a path and a dot, by what follows.
  [[nodiscard]] KeyedValues within(const std::string& path) const;
  [[nodiscard]] bool empty() const;
  [[nodiscard]] bool has(const std::string& key) const;
  /// Whether there is a value or a group of this path.
  [[nodiscard]] bool hasPath(const std::string& path) const;
  /// The first of several spellings that is there; empty: none.
  [[nodiscard]] std::string find(const std::vector<const char*>& spellings) const;

  /// Words with spaces between them.
  /// @param what is expected, for the complaint where there is none
  [[nodiscard]] std::string text(const std::string& key, const std::string& what) const;
  [[nodiscard]] double number(const std::string& key) const;
  [[nodiscard]] std::vector<double> numbers(const std::string& key) const;
  /// @param counts how many there may be
  [[nodiscard]] std::vector<double> numbers(const std::string& key,
                                            const std::vector<std::size_t>& counts,
                                            const std::string& what) const;

  [[nodiscard]] IoError error(const std::string& key, const std::string& what) const;
  [[nodiscard]] const std::filesystem::path& file() const { return file_; }

 private:
  [[nodiscard]] const KeyedValue& at(const std::string& key) const;

  std::filesystem::path file_;
  std::string prefix_;
  std::shared_ptr<std::map<std::string, KeyedValue>> values_;
};

/// Most that is read of a file.
struct YamlLimits {
  std::size_t bytes;
  std::size_t values;
};
inline constexpr YamlLimits kPlainLimits{kMaxYamlBytes, kMaxYamlValues};
inline constexpr YamlLimits kJsonLimits{std::size_t{1} << 25, 1000000};  // poses of many images

/// Values of a YAML document, which may begin as cv::FileStorage writes it. JSON is a part of YAML.
[[nodiscard]] KeyedValues yamlValues(const std::filesystem::path& file, const YamlLimits& limits);
/// Values of an XML file that cv::FileStorage wrote.
[[nodiscard]] KeyedValues xmlValues(const std::filesystem::path& file, const std::string& text);

}  // namespace dsorb::io
