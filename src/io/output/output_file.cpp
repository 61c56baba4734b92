// SPDX-License-Identifier: BSD-3-Clause
#include "io/output/output_file.h"

#include "io/output/json_text.h"

#include <fmt/format.h>

#include <cerrno>
#include <fstream>
#include <regex>
#include <system_error>
#include <utility>
#include <vector>

namespace dsorb::io {
namespace {

namespace fs = std::filesystem;

constexpr const char* kSummary = "run.json";
constexpr const char* kFigures = "figures";

FileHandle openForWriting(const fs::path& path) {
  FileHandle file(std::fopen(path.string().c_str(), "wb"));
  if (!file) throw writeError(path);
  return file;
}

void writeAll(std::FILE* file, std::string_view text, const fs::path& path) {
  if (std::fwrite(text.data(), 1, text.size(), file) != text.size() || std::fflush(file) != 0) {
    throw writeError(path);
  }
}

/// Files of a run, by their names relative to the output folder. Those of earlier versions count.
std::vector<fs::path> outputFilesIn(const fs::path& folder) {
  std::vector<fs::path> found;
  for (const fs::path& part : {fs::path(), fs::path(kFigures)}) {
    if (!fs::is_directory(folder / part)) continue;
    for (const auto& entry : fs::directory_iterator(folder / part)) {
      const fs::path name = part / entry.path().filename();
      if (!entry.is_directory() && isOutputFile(name)) found.push_back(name);
    }
  }
  return found;
}

bool isSummaryOf(const std::string& program, const fs::path& run_json) {
  std::ifstream file(run_json);
  const Json json = Json::parse(file, nullptr, false);
  return json.is_object() && json.contains("program") && json["program"] == program;
}

}  // namespace

IoError writeError(const fs::path& path) {
  return IoError(fmt::format(
      "{}: cannot be written: {}", path.string(), std::generic_category().message(errno)));
}

GrowingFile::GrowingFile(fs::path path) : path_(std::move(path)), file_(openForWriting(path_)) {}

void GrowingFile::append(std::string_view text) {
  writeAll(file_.get(), text, path_);
}

void GrowingFile::replaceEnd(std::uintmax_t keep, std::string_view text) {
  try {
    overwrite(keep, text);
  } catch (const IoError&) {
    file_.reset(std::fopen(path_.string().c_str(), "r+b"));  // what waits to be written goes
    try {
      if (file_) overwrite(end_begin_, end_);  // it has its place on the disk
    } catch (const IoError&) {
      // The first error says more.
    }
    throw;
  }
  end_begin_ = keep;
  end_ = text;
}

void GrowingFile::overwrite(std::uintmax_t begin, std::string_view text) {
  if (std::fseek(file_.get(), static_cast<long>(begin), SEEK_SET) != 0) throw writeError(path_);
  append(text);
  std::error_code error;
  fs::resize_file(path_, begin + text.size(), error);
  if (!error) return;
  errno = error.value();
  throw writeError(path_);
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
  std::error_code failed;
  if (closed) fs::rename(part_, path_, failed);
  if (closed && !failed) return;
  if (failed) errno = failed.value();
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

bool isOutputFile(const fs::path& name) {
  static const std::regex kNames(
      R"((trajectory(_kitti|_\d+)?\.txt|keyframes(_\d+)?\.txt|initialization\.json|frames\.csv|)"
      R"(points\.ply|tracks\.ply|refined_camera\.txt|run\.json|config\.yaml)(\.part)?|points\.spool|)"
      R"(figures/(initial_inverse_depth(_\d+)?|trajectory|timeline)\.png(\.part)?)");
  return std::regex_match(name.generic_string(), kNames);
}

OutputFolder::OutputFolder(const fs::path& folder,
                           const std::string& program,
                           std::string_view run_json) {
  try {
    fs::create_directories(folder);
    if (!platform::lockFolder(folder, lock_)) {
      throw IoError(fmt::format("output folder {}: another run writes into it", folder.string()));
    }
    if (fs::is_symlink(folder / kFigures)) {
      throw IoError(fmt::format(
          "output folder {}: {} there is a link; move it away", folder.string(), kFigures));
    }
    const std::vector<fs::path> old = outputFilesIn(folder);
    if (!old.empty() && !isSummaryOf(program, folder / kSummary)) {
      throw IoError(
          fmt::format("output folder {}: {} there is not from a run of {}; it would be replaced. "
                      "Choose another folder or move it away",
                      folder.string(),
                      old.front().generic_string(),
                      program));
    }
    fs::create_directory(folder / kFigures);
    replaceFile(folder / kSummary, run_json);
    for (const fs::path& name : old) {
      if (name != kSummary) fs::remove(folder / name);
    }
  } catch (const fs::filesystem_error& error) {
    throw IoError(fmt::format(
        "output folder {}: cannot be prepared: {}", folder.string(), error.code().message()));
  }
}

}  // namespace dsorb::io
