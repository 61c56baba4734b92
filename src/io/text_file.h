// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/error.h"

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace dsorb {

/// A line with content, trimmed of white space and carriage return.
struct TextLine {
  int number = 0;  ///< position in the file, from 1
  std::string text;
};

/// Lines of a text file without empty lines and lines that start with '#'.
/// @throws IoError where the file is missing or unreadable
std::vector<TextLine> readLines(const std::filesystem::path& file);

/// Message "FILE:LINE: what"; the line is left out where it is 0.
IoError lineError(const std::filesystem::path& file, int line, const std::string& what);

/// Words between white space, commas not included.
std::vector<std::string> splitWords(std::string_view text);

std::string_view trimmed(std::string_view text);

/// Whole text as a finite number, independent of the locale. @return false where it is none
bool parseNumber(std::string_view text, double& value);

/// Words as finite numbers.
/// @param what names the expectation in the message, for example "fx fy cx cy 0"
/// @throws IoError naming the word that is no finite number
std::vector<double> parseNumbers(const std::filesystem::path& file,
                                 int line,
                                 const std::vector<std::string>& words,
                                 const std::string& what);

}  // namespace dsorb
