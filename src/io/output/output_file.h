// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/error.h"

#include "platform/files.h"

#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>

namespace dsorb::io {

/// Ends the name of what is to take the place of a file.
constexpr const char* kPartSuffix = ".part";

struct CloseFile {
  void operator()(std::FILE* file) const { std::fclose(file); }
};
using FileHandle = std::unique_ptr<std::FILE, CloseFile>;

/// A file that grows by whole records; each one is handed to the operating system at once.
class GrowingFile {
 public:
  /// Starts with an empty file. @throws IoError where it cannot be created
  explicit GrowingFile(std::filesystem::path path);
  /// @throws IoError where not all could be written, for example on a full disk
  void append(std::string_view text);
  /// The content becomes its first `keep` bytes and then the text.
  /// @throws IoError as append(); what an earlier call wrote is there again then
  void replaceEnd(std::uintmax_t keep, std::string_view text);

 private:
  void overwrite(std::uintmax_t begin, std::string_view text);

  std::filesystem::path path_;
  FileHandle file_;
  std::uintmax_t end_begin_ = 0;
  std::string end_;  ///< what replaceEnd() wrote last, from there on
};

/// Replaces a file as a whole: readers see the old or the new content, never a part.
class ReplacingFile {
 public:
  /// @throws IoError where nothing can be written beside the file
  explicit ReplacingFile(std::filesystem::path path);
  /// Leaves the old content in place unless commit() was called.
  ~ReplacingFile();
  ReplacingFile(const ReplacingFile&) = delete;
  ReplacingFile& operator=(const ReplacingFile&) = delete;

  /// @throws IoError where not all could be written
  void append(std::string_view text);
  /// Puts what was appended in the file's place. @throws IoError where that fails
  void commit();

 private:
  std::filesystem::path path_;
  std::filesystem::path part_;
  FileHandle file_;
};

/// Replaces a file by this content, as a whole.
/// @throws IoError where it cannot be written; the old content stays
void replaceFile(const std::filesystem::path& path, std::string_view content);

/// The error of the last system call on this file, in words.
[[nodiscard]] IoError writeError(const std::filesystem::path& path);

/// Whether a run writes a file of this name, given relative to its output folder.
[[nodiscard]] bool isOutputFile(const std::filesystem::path& name);

/// The folder that a run writes into. While it lives no other run of this library does.
class OutputFolder {
 public:
  /// Creates the folder if needed, puts the new run.json there and removes every other file that an
  /// earlier run of the program wrote.
  /// @param run_json of a run that just begins; it names the program
  /// @throws IoError where the folder cannot be created or written to, another run writes into it,
  ///         or it holds files named as those of a run, but no run.json of the program
  OutputFolder(const std::filesystem::path& folder,
               const std::string& program,
               std::string_view run_json);

 private:
  platform::Descriptor lock_;  // of the folder
};

}  // namespace dsorb::io
