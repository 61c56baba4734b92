// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/error.h"
#include "dsorb/geometry/se3.h"

#include "platform/files.h"

#include <nlohmann/json.hpp>

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <utility>

namespace dsorb::io {

struct CloseFile {
  void operator()(std::FILE* file) const { std::fclose(file); }
};
using FileHandle = std::unique_ptr<std::FILE, CloseFile>;

/// A file that grows by whole records; each one is handed to the operating system at once.
class GrowingFile {
 public:
  /// Starts with an empty file. @throws IoError where it cannot be created
  explicit GrowingFile(std::filesystem::path path);
  /// @throws IoError where not all could be written, for example on a full disk; the file is then
  ///         as before
  void append(std::string_view text);
  /// The same in place of what the file ends with. @throws IoError as append()
  void replaceEnd(std::string_view end, std::string_view text);
  /// Overwrites what stands at a position. @throws IoError
  void write(std::uintmax_t position, std::string_view text);
  /// @throws IoError where not all of it can be read
  [[nodiscard]] std::string read(std::uintmax_t position, std::size_t bytes) const;

 private:
  std::filesystem::path path_;
  FileHandle file_;          // without a buffer: nothing waits to be written after a failure
  std::uintmax_t size_ = 0;  // of what was appended
};

/// Replaces a file by this content: readers see the old or the new one, never a part.
/// @throws IoError where it cannot be written; the old content stays
void replaceFile(const std::filesystem::path& path, std::string_view content);

/// A line `timestamp tx ty tz qx qy qz qw`, nine decimals, qw not negative.
/// @source TUM RGB-D benchmark, file formats
[[nodiscard]] std::string tumLine(double timestamp, const SE3& T_world_cam);

/// Whether rotation and translation hold neither nan nor infinity.
[[nodiscard]] bool isFinite(const SE3& pose);

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

using Json = nlohmann::ordered_json;

/// Text of a JSON value, indented; arrays of plain values stay on one line. Numbers are the
/// shortest that read back the same, but a `timestamp` has nine decimals as in every file; nan and
/// infinity become null.
[[nodiscard]] std::string jsonText(const Json& value);

/// The intrinsics as every file has them.
[[nodiscard]] Json cameraJson(const PinholeCamera& camera);

/// [tx, ty, tz, qx, qy, qz, qw], qw not negative; null where not finite.
[[nodiscard]] Json poseJson(const SE3& pose);

/// The double whose shortest text is that of the float: 0.1f gives 0.1.
[[nodiscard]] double shortest(float value);

}  // namespace dsorb::io
