// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"

#include "io/output/json_text.h"
#include "io/output/run_record.h"
#include "io/output/whole_file.h"

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>

namespace dsorb::io {

/// initialization.json: one object per successful initialization, added when it comes. Only the
/// last one is kept: no other can be taken back.
class InitializationWriter {
 public:
  /// Writes the empty list. @throws IoError where it cannot be written
  InitializationWriter(std::filesystem::path path, std::string initializer);

  void setCamera(const PinholeCamera& camera) { camera_ = camera; }

  /// Counts the current frame and writes when it brought or took back an initialization.
  void update(const RunRecord& record, double milliseconds);

 private:
  /// The start of a segment up to now.
  struct Progress {
    int segment = -1;
    int frames_given = 0;
    int resets = 0;
    double total_milliseconds = 0;
    double attempt_milliseconds = 0;  ///< since the last reset
  };

  [[nodiscard]] Json describe(const InitStepNote& step, double milliseconds) const;
  void add(Json initialization);
  /// Brings the file up to date.
  void write();

  WholeFile file_;
  std::string initializer_;
  PinholeCamera camera_;
  Progress progress_;
  Json last_;                  ///< null before the first one
  std::uintmax_t last_begin_;  ///< its place in the file
  std::size_t last_size_ = 0;
  bool changed_ = false;
};

}  // namespace dsorb::io
