// SPDX-License-Identifier: BSD-3-Clause
#include "io/text_file.h"

#include "platform/files.h"

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <system_error>

namespace dsorb {
namespace {

constexpr std::string_view kWhiteSpace = " \t\r\n\v\f";
constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";  // editors of Windows begin with it
constexpr std::size_t kMaxQuotable = 80;                     // characters

}  // namespace

std::string_view trimmed(std::string_view text) {
  const std::size_t first = text.find_first_not_of(kWhiteSpace);
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(kWhiteSpace) - first + 1);
}

std::string readText(const std::filesystem::path& file, std::size_t most_bytes) {
  std::string text;
  const platform::Reading reading = platform::readWhole(file, most_bytes, text);
  if (reading == platform::Reading::kFailed) {
    throw fileError(
        file, "cannot be opened for reading: {}", std::generic_category().message(errno));
  }
  if (reading == platform::Reading::kTooLarge) {
    throw fileError(file, "too large; at most {} KiB of text are expected", most_bytes >> 10U);
  }
  if (reading == platform::Reading::kNobodyWrites) {
    throw fileError(file, "a pipe that nobody writes to");
  }
  if (text.compare(0, kByteOrderMark.size(), kByteOrderMark) == 0) {
    text.erase(0, kByteOrderMark.size());
  }
  const std::size_t zero = text.find('\0');
  if (zero != std::string::npos) {
    const auto end = text.begin() + static_cast<std::ptrdiff_t>(zero);
    const auto line = 1 + std::count(text.begin(), end, '\n');
    throw lineError(file, static_cast<int>(line), "a zero byte; text is expected");
  }
  return text;
}

std::vector<TextLine> readLines(const std::filesystem::path& file, std::size_t most_bytes) {
  const std::string text = readText(file, most_bytes);
  const std::string_view all = text;
  const auto name = std::make_shared<const std::filesystem::path>(file);
  std::vector<TextLine> lines;
  int number = 1;
  for (std::size_t begin = 0; begin < all.size(); ++number) {
    const std::size_t end = std::min(all.find('\n', begin), all.size());
    const std::string_view content = trimmed(all.substr(begin, end - begin));
    if (!content.empty() && content.front() != '#') {
      lines.push_back({number, std::string(content), name});
    }
    begin = end + 1;
  }
  return lines;
}

std::string pixelText(double width, double height) {
  return fmt::format("{}x{} px", width, height);
}

std::string quotable(std::string_view text) {
  if (text.size() <= kMaxQuotable) return std::string(text);
  return std::string(text.substr(0, kMaxQuotable)) + "...";
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

std::vector<double> TextLine::numbers(const std::vector<std::string>& words,
                                      const std::string& what) const {
  std::vector<double> values;
  for (const std::string& word : words) {
    if (!parseNumber(word, values.emplace_back())) {
      throw error("'{}' is not a finite number; expected {}", quotable(word), what);
    }
  }
  return values;
}

}  // namespace dsorb
