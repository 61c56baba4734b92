// SPDX-License-Identifier: BSD-3-Clause
#include "io/text_file.h"

#include <fmt/format.h>

#include <charconv>
#include <cmath>
#include <fstream>

namespace dsorb {
namespace {

constexpr std::string_view kWhiteSpace = " \t\r\n\v\f";

}  // namespace

std::string_view trimmed(std::string_view text) {
  const std::size_t first = text.find_first_not_of(kWhiteSpace);
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(kWhiteSpace) - first + 1);
}

std::vector<TextLine> readLines(const std::filesystem::path& file) {
  std::ifstream stream(file);
  if (!stream || std::filesystem::is_directory(file)) {
    throw IoError(fmt::format("{}: cannot be opened for reading", file.string()));
  }
  std::vector<TextLine> lines;
  std::string text;
  for (int number = 1; std::getline(stream, text); ++number) {
    const std::string_view content = trimmed(text);
    if (!content.empty() && content.front() != '#') {
      lines.push_back({number, std::string(content)});
    }
  }
  return lines;
}

IoError lineError(const std::filesystem::path& file, int line, const std::string& what) {
  if (line <= 0) return IoError(fmt::format("{}: {}", file.string(), what));
  return IoError(fmt::format("{}:{}: {}", file.string(), line, what));
}

std::vector<std::string> splitWords(std::string_view text) {
  std::vector<std::string> words;
  std::size_t begin = text.find_first_not_of(kWhiteSpace);
  while (begin != std::string_view::npos) {
    const std::size_t end = text.find_first_of(kWhiteSpace, begin);
    words.emplace_back(text.substr(begin, end - begin));
    begin = end == std::string_view::npos ? end : text.find_first_not_of(kWhiteSpace, end);
  }
  return words;
}

bool parseNumber(std::string_view text, double& value) {
  if (!text.empty() && text.front() == '+') text.remove_prefix(1);
  const char* end = text.data() + text.size();
  const auto [rest, error] = std::from_chars(text.data(), end, value);
  return error == std::errc() && rest == end && std::isfinite(value);
}

std::vector<double> parseNumbers(const std::filesystem::path& file,
                                 int line,
                                 const std::vector<std::string>& words,
                                 const std::string& what) {
  std::vector<double> numbers;
  numbers.reserve(words.size());
  for (const std::string& word : words) {
    double value = 0;
    if (!parseNumber(word, value)) {
      throw lineError(
          file, line, fmt::format("'{}' is not a finite number; expected {}", word, what));
    }
    numbers.push_back(value);
  }
  return numbers;
}

}  // namespace dsorb
