// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/error.h"

#include <fmt/format.h>

#include <cstddef>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace dsorb {

/// Message "FILE:LINE: what"; the line is left out where it is 0.
[[nodiscard]] IoError lineError(const std::filesystem::path& file,
                                int line,
                                const std::string& what);
/// The same of a text with {} for each part.
template <typename First, typename... Parts>
[[nodiscard]] IoError lineError(const std::filesystem::path& file,
                                int line,
                                std::string_view text,
                                const First& first,
                                const Parts&... parts) {
  return lineError(file, line, fmt::format(fmt::runtime(text), first, parts...));
}
/// Message "FILE: what".
template <typename... Parts>
[[nodiscard]] IoError fileError(const std::filesystem::path& file, const Parts&... what) {
  return lineError(file, 0, what...);
}

/// A line with content, trimmed of white space and carriage return.
struct TextLine {
  int number = 0;  ///< position in the file, from 1
  std::string text;
  std::shared_ptr<const std::filesystem::path> file;

  /// Message "FILE:LINE: what".
  template <typename... Parts>
  [[nodiscard]] IoError error(const Parts&... what) const {
    return lineError(*file, number, what...);
  }
  /// Words as finite numbers.
  /// @param what names the expectation in the message, for example "fx fy cx cy 0"
  /// @throws IoError naming the word that is no finite number
  [[nodiscard]] std::vector<double> numbers(const std::vector<std::string>& words,
                                            const std::string& what) const;
};

/// Most that is read of a file: configurations, calibrations with responses of 16 bits, and lists
/// of a million images are far smaller.
inline constexpr std::size_t kMaxYamlBytes = std::size_t{1} << 18;
inline constexpr std::size_t kMaxCalibrationBytes = std::size_t{1} << 22;
inline constexpr std::size_t kMaxListBytes = std::size_t{1} << 26;

/// Whole content of a text file or of a pipe, without a byte order mark.
/// @throws IoError where it is missing, unreadable, larger than `most_bytes` or holds a zero byte,
///         and where nobody writes to the pipe
std::string readText(const std::filesystem::path& file, std::size_t most_bytes);

/// Lines of a text file without empty lines and lines that start with '#'.
/// @throws IoError as readText() does
std::vector<TextLine> readLines(const std::filesystem::path& file, std::size_t most_bytes);

/// Words between white space, commas not included.
std::vector<std::string> splitWords(std::string_view text);

/// "640x480 px", for messages.
std::string pixelText(double width, double height);

/// Text as a message may quote it: without what exceeds a line of a terminal.
std::string quotable(std::string_view text);

std::string_view trimmed(std::string_view text);

/// Whole text as a finite number, independent of the locale. @return false where it is none
bool parseNumber(std::string_view text, double& value);

}  // namespace dsorb
