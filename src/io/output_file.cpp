// SPDX-License-Identifier: BSD-3-Clause
#include "io/output_file.h"

#include "dsorb/error.h"

#include <fmt/format.h>

#include <cerrno>
#include <regex>
#include <system_error>
#include <utility>
#include <vector>

namespace dsorb::io {
namespace {

namespace fs = std::filesystem;

constexpr const char* kPartSuffix = ".part";

IoError writeError(const fs::path& path) {
  return IoError(fmt::format(
      "{}: cannot be written: {}", path.string(), std::generic_category().message(errno)));
}

FileHandle openForWriting(const fs::path& path) {
  FileHandle file(std::fopen(path.c_str(), "wb"));
  if (!file) throw writeError(path);
  return file;
}

void writeAll(std::FILE* file, std::string_view text, const fs::path& path) {
  if (std::fwrite(text.data(), 1, text.size(), file) != text.size() || std::fflush(file) != 0) {
    throw writeError(path);
  }
}

/// Removes the regular files of a folder whose whole name matches.
void removeMatching(const fs::path& folder, const std::regex& names) {
  std::vector<fs::path> found;
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (!entry.is_directory() && std::regex_match(entry.path().filename().string(), names)) {
      found.push_back(entry.path());
    }
  }
  for (const fs::path& path : found) fs::remove(path);
}

}  // namespace

GrowingFile::GrowingFile(fs::path path) : path_(std::move(path)), file_(openForWriting(path_)) {}

void GrowingFile::append(std::string_view text) {
  writeAll(file_.get(), text, path_);
}

ReplacingFile::ReplacingFile(fs::path path)
    : path_(std::move(path)), part_(path_.string() + kPartSuffix), file_(openForWriting(part_)) {}

ReplacingFile::~ReplacingFile() {
  if (!file_) return;
  file_.reset();
  std::error_code ignored;
  fs::remove(part_, ignored);
}

void ReplacingFile::append(std::string_view text) {
  writeAll(file_.get(), text, path_);
}

void ReplacingFile::commit() {
  const bool closed = std::fclose(file_.release()) == 0;
  if (closed && std::rename(part_.c_str(), path_.c_str()) == 0) return;
  const IoError error = writeError(path_);
  std::error_code ignored;
  fs::remove(part_, ignored);
  throw error;
}

void replaceFile(const fs::path& path, std::string_view content) {
  ReplacingFile file(path);
  file.append(content);
  file.commit();
}

void prepareOutputFolder(const fs::path& folder) {
  static const std::regex kFiles(
      R"((trajectory(_kitti|_\d+)?\.txt|keyframes(_\d+)?\.txt|initialization\.json|frames\.csv|)"
      R"(points\.ply|run\.json|config\.yaml)(\.part)?|points\.spool)");
  static const std::regex kFigures(
      R"((initial_inverse_depth(_\d+)?|trajectory|timeline)\.png(\.part)?)");
  try {
    const fs::path figures = folder / "figures";
    fs::create_directories(figures);
    removeMatching(folder, kFiles);
    removeMatching(figures, kFigures);
  } catch (const fs::filesystem_error& error) {
    throw IoError(fmt::format(
        "output folder {}: cannot be prepared: {}", folder.string(), error.code().message()));
  }
}

}  // namespace dsorb::io
