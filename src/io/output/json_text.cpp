// SPDX-License-Identifier: BSD-3-Clause
#include "io/output/json_text.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>

namespace dsorb::io {
namespace {

constexpr const char* kTimestampKey = "timestamp";

bool isFlat(const Json& value) {
  return std::none_of(
      value.begin(), value.end(), [](const Json& element) { return element.is_structured(); });
}

/// A path may hold bytes that are no UTF-8.
std::string dumped(const Json& value) {
  return value.dump(-1, ' ', false, Json::error_handler_t::replace);
}

/// Arrays of numbers and matrices stay on one line.
bool onOneLine(const Json& value) {
  if (!value.is_array()) return !value.is_structured() || value.empty();
  return isFlat(value);
}

void write(const Json& value, int depth, std::string& text) {
  if (onOneLine(value)) {
    text += dumped(value);
    return;
  }
  const bool object = value.is_object();
  text += object ? '{' : '[';
  const char* separator = "\n";
  for (const auto& [key, element] : value.items()) {
    text += separator;
    separator = ",\n";
    text.append(static_cast<std::size_t>(depth) + 1, ' ');
    if (object) text += dumped(key) + ": ";
    if (object && key == kTimestampKey && element.is_number_float()) {
      text += fmt::format("{:.9f}", element.get<double>());
    } else {
      write(element, depth + 1, text);
    }
  }
  text += '\n';
  text.append(static_cast<std::size_t>(depth), ' ');
  text += object ? '}' : ']';
}

}  // namespace

std::string jsonText(const Json& value) {
  return jsonText(value, 0) + '\n';
}

std::string jsonText(const Json& value, int depth) {
  std::string text;
  write(value, depth, text);
  return text;
}

double shortest(float value) {
  const std::string text = fmt::format("{}", value);
  double result = value;
  std::from_chars(text.data(), text.data() + text.size(), result);
  return result;
}

}  // namespace dsorb::io
